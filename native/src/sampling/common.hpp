// The kernels in plain C++, and what they share with those for one instruction set.
//
// Everything here has internal linkage: this file is compiled once per instruction set, and the linker must
// never pick a function that was compiled for another one. For the same reason nothing of the standard
// library that has a body is called.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "job.hpp"

namespace omnimirror {
namespace {

template <class T>
T smaller(T a, T b) {
    return b < a ? b : a;
}
template <class T>
T larger(T a, T b) {
    return a < b ? b : a;
}

// Fractions of deep pictures are finer: 1/65535 of a pixel instead of 1/255. A fraction of 1 occurs, at the
// last pixel, which has no right or lower neighbour.
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

// Pictures with more values are fetched ahead: those that a core's own cache does not hold beside what else goes through
// it. What all cores share is far away, and often lost to other work by the next frame.
constexpr int64_t FETCHED_FROM = 250'000;
constexpr int AHEAD = 16;  // so many strips, some 8 rows of a panel, are located before they are sampled

constexpr int round_up8(int n) { return (n + 7) & ~7; }

}  // namespace
}  // namespace omnimirror
