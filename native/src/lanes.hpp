// Loops over lanes, which compilers vectorise. Everything has internal linkage, because kernels are compiled once per
// instruction set.
#pragma once

namespace omnimirror {
namespace {

constexpr int LANE = 8;  // arrays are padded to a multiple of it, and sums have this many partial sums

#if defined(__GNUC__) && !defined(__clang__)
#define OMNIMIRROR_LANES(i, k) _Pragma("GCC ivdep") _Pragma("GCC unroll 1") for (int i = (k); i < (k) + LANE; ++i)
#else
#define OMNIMIRROR_LANES(i, k) for (int i = (k); i < (k) + LANE; ++i)
#endif
#define OMNIMIRROR_RESTRICT __restrict__

constexpr int padded(int count) { return (count + LANE - 1) / LANE * LANE; }

inline double sqrt_of(double x) { return __builtin_sqrt(x); }
inline double max_of(double a, double b) { return a > b ? a : b; }
inline double min_of(double a, double b) { return a < b ? a : b; }
inline double abs_of(double a) { return a < 0 ? -a : a; }

}  // namespace
}  // namespace omnimirror
