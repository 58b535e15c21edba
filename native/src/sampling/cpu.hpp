// Run-time selection of the instruction set.
#pragma once

#include <cstring>

#include "job.hpp"

namespace omnimirror {

#if defined(OMNIMIRROR_AVX512)
// Exactly the flags with which kernels_avx512.cpp is compiled. The compiler's library also checks that the operating
// system saves these registers (XGETBV).
inline bool has_avx512() {
    return __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
           __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl") &&
           __builtin_cpu_supports("avx512vbmi") && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma");
}
#endif

// Return the kernels with this name, or nullptr if the machine or the build does not support them.
inline const Kernels* kernels_named(const char* name) {
#if defined(OMNIMIRROR_AVX512)
    if (!std::strcmp(name, "avx512") && has_avx512()) return &avx512_kernels;
    if (!std::strcmp(name, "avx512-gather") && has_avx512()) return &avx512_gather_kernels;
#endif
#if defined(OMNIMIRROR_AVX2)
    if (!std::strcmp(name, "avx2") && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"))
        return &avx2_kernels;
#endif
#if defined(OMNIMIRROR_NEON)
    if (!std::strcmp(name, "neon")) return &neon_kernels;  // part of every 64-bit ARM processor
#endif
    return std::strcmp(name, "plain") ? nullptr : &plain_kernels;
}

inline const Kernels* best_kernels() {
#if defined(OMNIMIRROR_AVX512)
    if (__builtin_cpu_is("intel") && has_avx512()) return &avx512_gather_kernels;
#endif
    for (const char* name : {"avx512", "avx2", "neon"})
        if (const Kernels* kernels = kernels_named(name)) return kernels;
    return &plain_kernels;
}

}  // namespace omnimirror
