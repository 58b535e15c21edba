// Shared by all bindings: array types, argument checks, and the functions that register the kernels of each folder.
//
// Every array passes through `checked` before its memory is used, independent of checks in Python: no argument may
// cause a kernel to read or write outside a buffer.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <type_traits>
#include <vector>

namespace omnimirror {

namespace nb = nanobind;
using namespace nb::literals;

// Contiguous arrays of exactly this type, without conversion.
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

constexpr int64_t ANY = -1;                        // any length in an expected shape
constexpr int64_t MAX_LENGTH = int64_t{1} << 40;   // per dimension: products of three array lengths fit into 64 bits
constexpr int64_t MAX_COUNT = (int64_t{1} << 30) - 1;  // limit of counts that kernels store as int

enum class Values { any, finite };

// Raise ValueError. Defined in bindings.cpp, so that the text is formatted in one place.
[[noreturn]] void raise_invalid_shape(const char* name, std::initializer_list<int64_t> expected, size_t ndim,
                                      const int64_t* shape);
[[noreturn]] void raise_invalid(const char* name, const char* condition);
[[noreturn]] void raise_out_of_range(const char* name, double low, double high, double value);

// Check dimensions, lengths, alignment and, optionally, that all values are finite; return a pointer to the first
// value. The types above check contiguity and type; the functions for images and coordinates, whose rows may have gaps,
// check strides.
template <class A>
auto checked(const A& array, const char* name, std::initializer_list<int64_t> shape, Values values = Values::any)
    -> decltype(array.data()) {
    bool is_valid = array.ndim() == shape.size();
    for (size_t i = 0; is_valid && i < shape.size(); ++i) {
        const int64_t length = static_cast<int64_t>(array.shape(i)), expected = shape.begin()[i];
        is_valid = length >= 0 && length < MAX_LENGTH && (expected == ANY || length == expected);
    }
    if (!is_valid) raise_invalid_shape(name, shape, array.ndim(), array.shape_ptr());
    const uintptr_t bytes = array.dtype().bits / 8;
    if (array.size() && bytes && reinterpret_cast<uintptr_t>(array.data()) % bytes)
        raise_invalid(name, "must be aligned");
    if constexpr (std::is_floating_point_v<typename A::Scalar>) {
        if (values == Values::finite)
            for (size_t i = 0; i < array.size(); ++i)
                if (!std::isfinite(array.data()[i])) raise_invalid(name, "must be finite");
    }
    return array.data();
}

// Check that a number is within limits; NaN is not.
template <class T>
T checked(T value, const char* name, T low, T high) {
    if (!(value >= low && value <= high))
        raise_out_of_range(name, static_cast<double>(low), static_cast<double>(high), static_cast<double>(value));
    return value;
}

// Return a length as the int that kernels require.
inline int count_of(size_t length, const char* name, int64_t limit = MAX_COUNT) {
    if (length > static_cast<size_t>(limit))
        raise_out_of_range(name, 0, static_cast<double>(limit), static_cast<double>(length));
    return static_cast<int>(length);
}

// Maximum iterations of a search: sufficient for all searches that converge.
inline int iterations_of(int count, const char* name, int low = 0) { return checked(count, name, low, 1 << 14); }

// Return the length along a dimension, or 0 if there is no such dimension: `checked` then rejects the array.
template <class A>
int64_t length_of(const A& array, size_t axis) {
    return axis < array.ndim() ? static_cast<int64_t>(array.shape(axis)) : 0;
}

void add_sampling(nb::module_& m);     // sampling/module.cpp: omnimirror.dewarp
void add_designs(nb::module_& m);      // designs/module.cpp: omnimirror.optics.batch
void add_exposure(nb::module_& m);     // exposure/module.cpp: omnimirror.simulation.rendering
void add_surfaces(nb::module_& m);     // exposure/surfaces_module.cpp: omnimirror.simulation.scenes
void add_deconvolution(nb::module_& m);  // deconvolution/module.cpp: omnimirror.dewarp.restoration
void add_tolerancing(nb::module_& m);  // tolerancing/module.cpp: omnimirror.manufacturing.tolerancing
void add_reflection(nb::module_& m);   // reflection/module.cpp: omnimirror.optics.tracing, interop.torch

}  // namespace omnimirror
