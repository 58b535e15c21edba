// Plain C++ kernels, and code shared with the kernels for specific instruction sets.
//
// All functions have internal linkage: this file is compiled once per instruction set, and the linker must never select
// a function compiled for another one. For the same reason, no standard-library functions with a body are called.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "job.hpp"

namespace omnimirror {
namespace {

template <class T>
T min_of(T a, T b) {
    return b < a ? b : a;
}
template <class T>
T max_of(T a, T b) {
    return a < b ? b : a;
}

// Fractions for deep images are finer: 1/65535 pixel instead of 1/255. A fraction of 1 occurs at the last pixel, which
// has no right or lower neighbour.
template <class T>
struct FractionOf {
    using type = uint16_t;
};
template <>
struct FractionOf<uint8_t> {
    using type = uint8_t;
};
template <class T>
using Fraction = typename FractionOf<T>::type;
template <class F>
constexpr int one = sizeof(F) == 1 ? 255 : 65535;

// Images with more values are prefetched, because they do not fit into the private cache of a core beside the other
// data. The cache shared by all cores is slow, and often evicted by other work before the next frame.
constexpr int64_t MIN_PREFETCH_ELEMENTS = 250'000;
constexpr int PREFETCH_STRIPS = 16;  // strips (about 8 rows of a panel) that are located before they are sampled

constexpr int round_up8(int n) { return (n + 7) & ~7; }

}  // namespace
}  // namespace omnimirror
