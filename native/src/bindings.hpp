// What all rooms need to be called from Python: types of arrays, checks, and where each room hangs its names.
//
// Arrays are checked here once more, whatever the Python side has checked: no argument may make a kernel read
// or write outside a buffer.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>

namespace omnimirror {

namespace nb = nanobind;
using namespace nb::literals;

// Arrays without gaps, of exactly this type: nothing is converted.
template <class T, class... More>
using Array = nb::ndarray<T, More..., nb::c_contig, nb::device::cpu>;

using Floats = Array<const float>;
using FloatsOut = Array<float>;
using Doubles = Array<const double>;
using DoublesOut = Array<double>;
using Ints = Array<const int32_t>;
using IntsOut = Array<int32_t>;
using BytesOut = Array<uint8_t>;

inline void require(bool condition, const char* message) {
    if (!condition) throw nb::value_error(message);
}

inline bool is_aligned(const void* data, int bytes) {
    return reinterpret_cast<uintptr_t>(data) % static_cast<uintptr_t>(bytes) == 0;
}

// A length as kernels count it.
inline int count_of(size_t length) {
    require(length < (size_t{1} << 30), "an array is too long");
    return static_cast<int>(length);
}

void add_sampling(nb::module_& m);    // sampling/module.cpp: omnimirror.dewarp
void add_designs(nb::module_& m);     // designs/module.cpp: omnimirror.batch
void add_exposure(nb::module_& m);    // exposure/module.cpp: omnimirror.simulate.rendering
void add_surfaces(nb::module_& m);    // exposure/surfaces_module.cpp: omnimirror.simulate.scenes
void add_deblurring(nb::module_& m);  // deblur/module.cpp: omnimirror.simulate.restoration
void add_tolerancing(nb::module_& m);   // tolerancing/module.cpp: omnimirror.tolerancing
void add_reflection(nb::module_& m);    // reflection/module.cpp: omnimirror.tracing, omnimirror.torch

}  // namespace omnimirror
