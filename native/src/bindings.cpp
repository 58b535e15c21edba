// Texts of the errors raised by argument checks.
#include "bindings.hpp"

#include <cstdio>
#include <string>

namespace omnimirror {
namespace {

// Format as a Python tuple; "any" represents any length.
std::string text_of(const int64_t* lengths, size_t count) {
    std::string text = "(";
    for (size_t i = 0; i < count; ++i) {
        if (i) text += ", ";
        text += lengths[i] == ANY ? "any" : std::to_string(lengths[i]);
    }
    return text + (count == 1 ? ",)" : ")");
}

std::string text_of(double value) {
    char text[32];
    std::snprintf(text, sizeof text, "%.15g", value);
    return text;
}

[[noreturn]] void raise(const std::string& message) { throw nb::value_error(message.c_str()); }

}  // namespace

void raise_invalid_shape(const char* name, std::initializer_list<int64_t> expected, size_t ndim, const int64_t* shape) {
    raise(std::string(name) + " must have shape " + text_of(expected.begin(), expected.size()) + "; got " +
          text_of(shape, ndim));
}

void raise_invalid(const char* name, const char* condition) { raise(std::string(name) + " " + condition); }

void raise_out_of_range(const char* name, double low, double high, double value) {
    raise(std::string(name) + " must be between " + text_of(low) + " and " + text_of(high) + "; got " +
          text_of(value));
}

}  // namespace omnimirror
