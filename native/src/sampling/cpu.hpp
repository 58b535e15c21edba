// Which instruction set to use, from what the machine says when it runs.
#pragma once

#include <cstring>

#include "job.hpp"

namespace omnimirror {

// The kernels of that name, or nullptr where the machine or the build has none.
inline const Kernels* kernels_named(const char* name) {
#if defined(OMNIMIRROR_AVX2)
    if (!std::strcmp(name, "avx2") && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return &avx2_kernels;
#endif
#if defined(OMNIMIRROR_NEON)
    if (!std::strcmp(name, "neon")) return &neon_kernels;  // part of every 64-bit ARM
#endif
    return std::strcmp(name, "plain") ? nullptr : &plain_kernels;
}

inline const Kernels* best_kernels() {
    for (const char* name : {"avx2", "neon"})
        if (const Kernels* kernels = kernels_named(name)) return kernels;
    return &plain_kernels;
}

}  // namespace omnimirror
