// Additions of AVX-512 to AVX2: 64-byte vectors and arbitrary byte permutations in one instruction (VBMI).
#pragma once

#include "avx2.hpp"

namespace omnimirror {
namespace {

// A vector of bytes computed from their indices at compile time, because kernels are constructed once per strip.
struct alignas(64) Bytes {
    uint8_t bytes[64]{};
};

template <auto byte_at>
constexpr Bytes all_bytes() {
    Bytes all;
    for (int i = 0; i < 64; ++i) all.bytes[i] = static_cast<uint8_t>(byte_at(i));
    return all;
}

template <auto byte_at>
__m512i bytes_of() {
    static constexpr Bytes all = all_bytes<byte_at>();
    return _mm512_load_si512(all.bytes);
}

constexpr __mmask64 ODD_BYTES = 0xaaaaaaaaaaaaaaaa;
constexpr __mmask32 ODD_WORDS = 0xaaaaaaaa;

}  // namespace
}  // namespace omnimirror
