// AVX2 loads and stores.
#pragma once

#include <immintrin.h>

#include "common.hpp"

namespace omnimirror {
namespace {

__m128i load8(const uint8_t* p) { return _mm_loadl_epi64(reinterpret_cast<const __m128i*>(p)); }
__m128i load16(const void* p) { return _mm_loadu_si128(static_cast<const __m128i*>(p)); }
__m256i load32(const void* p) { return _mm256_loadu_si256(static_cast<const __m256i*>(p)); }
__m256i duplicate_lane(__m128i v) { return _mm256_broadcastsi128_si256(v); }
void store16(uint8_t* p, __m128i v) { _mm_storeu_si128(reinterpret_cast<__m128i*>(p), v); }

// Force the compiler to keep a constant in a register or on the stack. Otherwise it rebuilds constants for every 8
// pixels through general-purpose registers, which costs 20 % of the run time.
template <class V>
V in_register(V v) {
    asm("" : "+v"(v));
    return v;
}

// Load 16 bytes (two pixels) from each of two addresses.
__m128i load_pair(const uint8_t* a, const uint8_t* b) {
    return _mm_castpd_si128(_mm_loadh_pd(_mm_castsi128_pd(load8(a)), reinterpret_cast<const double*>(b)));
}

}  // namespace
}  // namespace omnimirror
