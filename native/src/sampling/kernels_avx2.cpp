// The kernels for x86 with AVX2. Only uint8 pictures have their own: they are what frames come in.
//
// Per output pixel a few unaligned loads fetch all neighbours of all channels; scalar address arithmetic
// beats hardware gathers.
#include <immintrin.h>

#include <cstddef>

#include "axial_kernel.hpp"
#include "footprint.hpp"

namespace omnimirror {
namespace {

__m128i load8(const uint8_t* p) { return _mm_loadl_epi64(reinterpret_cast<const __m128i*>(p)); }
__m128i load16(const void* p) { return _mm_loadu_si128(static_cast<const __m128i*>(p)); }
__m256i load32(const void* p) { return _mm256_loadu_si256(static_cast<const __m256i*>(p)); }
__m256i twice(__m128i v) { return _mm256_broadcastsi128_si256(v); }
void store16(uint8_t* p, __m128i v) { _mm_storeu_si128(reinterpret_cast<__m128i*>(p), v); }

// A constant that the compiler must keep, in a register or on the stack. Left to itself it makes constants anew
// for every 8 pixels, through general registers, which costs a fifth of the time.
template <class V>
V kept(V v) {
    asm("" : "+x"(v));
    return v;
}

// 16 bytes of two pixels from each of two addresses.
__m128i load_pair(const uint8_t* a, const uint8_t* b) {
    return _mm_castpd_si128(_mm_loadh_pd(_mm_castsi128_pd(load8(a)), reinterpret_cast<const double*>(b)));
}

// -- where output pixels look ----------------------------------------------------------------------

// One coordinate of 8 pixels.
struct Axis {
    __m256i first;  // the pixel left of it or above
    __m256 fraction;
    __m256i inside;  // all bits set where it lies on the picture
};

Axis along(const float* at, int size, int first_max) {
    const __m256 x = _mm256_loadu_ps(at);
    const float last = static_cast<float>(size - 1), end = static_cast<float>(size - 0.5);
    const __m256 inside = _mm256_and_ps(_mm256_cmp_ps(x, _mm256_set1_ps(-0.5f), _CMP_GE_OQ),
                                        _mm256_cmp_ps(x, _mm256_set1_ps(end), _CMP_LE_OQ));
    const __m256 kept = _mm256_min_ps(_mm256_max_ps(x, _mm256_setzero_ps()), _mm256_set1_ps(last));
    const __m256i first = _mm256_min_epi32(_mm256_cvttps_epi32(kept), _mm256_set1_epi32(first_max));
    return {first, _mm256_sub_ps(kept, _mm256_cvtepi32_ps(first)), _mm256_castps_si256(inside)};
}

struct HalfAxis {
    __m128i first, inside;
    __m128 fraction;
};

HalfAxis along_half(const double* at, int size, int first_max) {
    const __m256d x = _mm256_loadu_pd(at);
    const __m256d inside = _mm256_and_pd(_mm256_cmp_pd(x, _mm256_set1_pd(-0.5), _CMP_GE_OQ),
                                         _mm256_cmp_pd(x, _mm256_set1_pd(size - 0.5), _CMP_LE_OQ));
    const __m256d kept = _mm256_min_pd(_mm256_max_pd(x, _mm256_setzero_pd()), _mm256_set1_pd(size - 1));
    const __m128i first = _mm_min_epi32(_mm256_cvttpd_epi32(kept), _mm_set1_epi32(first_max));
    const __m128 fraction = _mm256_cvtpd_ps(_mm256_sub_pd(kept, _mm256_cvtepi32_pd(first)));
    const __m256i words = _mm256_castpd_si256(inside);
    const __m128i low = _mm256_castsi256_si128(words), high = _mm256_extracti128_si256(words, 1);
    return {first, _mm_packs_epi32(low, high), fraction};
}

Axis along(const double* at, int size, int first_max) {
    const HalfAxis a = along_half(at, size, first_max), b = along_half(at + 4, size, first_max);
    // The masks were packed to words, each of them twice: 32 bits again.
    return {_mm256_set_m128i(b.first, a.first), _mm256_set_m128(b.fraction, a.fraction),
            _mm256_set_m128i(b.inside, a.inside)};
}

__m256i is_beyond(__m256i first, int inner, uint32_t span) {
    const __m256i from = _mm256_sub_epi32(first, _mm256_set1_epi32(inner)),
                  most = _mm256_set1_epi32(static_cast<int>(span));
    return _mm256_xor_si256(_mm256_cmpeq_epi32(_mm256_max_epu32(from, most), most), _mm256_set1_epi32(-1));
}

__m256i in_255ths(__m256 fraction) {
    return _mm256_cvttps_epi32(_mm256_add_ps(_mm256_mul_ps(fraction, _mm256_set1_ps(255.0f)), _mm256_set1_ps(0.5f)));
}

void store_fractions(__m256i x, __m256i y, Block<uint8_t>& block) {
    const __m256i words = _mm256_packs_epi32(x, y);  // x 0-3, y 0-3; x 4-7, y 4-7
    const __m256i bytes = _mm256_packus_epi16(words, words);
    const __m128i sorted = _mm_unpacklo_epi32(_mm256_castsi256_si128(bytes), _mm256_extracti128_si256(bytes, 1));
    static_assert(offsetof(Block<uint8_t>, fy) == offsetof(Block<uint8_t>, fx) + 8);
    store16(block.fx, sorted);
}

// See locate in common.hpp, which this does 8 pixels at a time.
template <Interpolation I, class Real>
void locate_by_8(const Real* x, const Real* y, int count, const Geometry& geometry, Block<uint8_t>* blocks) {
    const Geometry g = geometry;
    const __m256i row_step = _mm256_set1_epi32(static_cast<int>(g.row_step));
    const __m256i pixel_step = _mm256_set1_epi32(static_cast<int>(g.pixel_step));
    for (int i = 0; i < count; i += 8) {
        const Axis across = along(x + i, g.width, g.x0_max), down = along(y + i, g.height, g.y0_max);
        store_fractions(in_255ths(across.fraction), in_255ths(down.fraction), blocks[i / 8]);
        const __m256i all = _mm256_set1_epi32(-1), inside = _mm256_and_si256(across.inside, down.inside);
        __m256i offset =
            _mm256_add_epi32(_mm256_mullo_epi32(down.first, row_step), _mm256_mullo_epi32(across.first, pixel_step));
        if constexpr (I == Interpolation::cubic) {
            const __m256i beyond = _mm256_or_si256(is_beyond(across.first, g.x_inner, g.x_span),
                                                   is_beyond(down.first, g.y_inner, g.y_span));
            const __m256i edge = _mm256_set1_epi32(static_cast<int>(EDGE));
            offset = _mm256_or_si256(offset, _mm256_and_si256(beyond, edge));
        }
        offset = _mm256_or_si256(offset, _mm256_xor_si256(inside, all));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(blocks[i / 8].offsets), offset);
    }
}

// Whether all that there is in a picture fits into 16 bits, with a sign.
bool is_narrow(const Geometry& g) { return g.width <= 0x7fff && g.height <= 0x7fff && g.row_step <= 0x7fff; }

// The same where all coordinates are inner ones and the picture is narrow, 8 at a time and in 65536ths of a pixel. Few
// steps that depend on each other: that is what counts here.
struct InnerLocator {
    __m256i steps, half = kept(_mm256_set1_epi16(128));
    __m256i apart = kept(twice(_mm_setr_epi8(1, 5, 9, 13, 3, 7, 11, 15, -1, -1, -1, -1, -1, -1, -1, -1)));
    __m256i together = kept(_mm256_setr_epi32(0, 4, 1, 5, 0, 4, 1, 5));

    explicit InnerLocator(const Geometry& g)
        : steps(kept(_mm256_set1_epi32(static_cast<int>(g.row_step << 16 | g.pixel_step)))) {}

    void put(__m256 x_fine, __m256 y_fine, Block<uint8_t>& block) const {
        const __m256i x = _mm256_cvtps_epi32(x_fine), y = _mm256_cvtps_epi32(y_fine);
        const __m256i pixels = _mm256_blend_epi16(_mm256_srli_epi32(x, 16), y, 0xaa);
        const __m256i fractions = _mm256_blend_epi16(x, _mm256_slli_epi32(y, 16), 0xaa);
        const __m256i in_255ths = _mm256_add_epi16(_mm256_sub_epi16(fractions, _mm256_srli_epi16(fractions, 8)), half);
        const __m256i bytes = _mm256_shuffle_epi8(in_255ths, apart);
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(block.offsets), _mm256_madd_epi16(pixels, steps));
        store16(block.fx, _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(bytes, together)));
    }
};

// See cell_row in common.hpp.
struct FourNodes {
    __m256 a, b, c, d;

    explicit FourNodes(const float* nodes)
        : a(_mm256_broadcast_ss(nodes)),
          b(_mm256_broadcast_ss(nodes + 1)),
          c(_mm256_broadcast_ss(nodes + 2)),
          d(_mm256_broadcast_ss(nodes + 3)) {}

    __m256 between(const float* w, int step) const {
        const __m256 left = _mm256_fmadd_ps(b, _mm256_loadu_ps(w + step), _mm256_mul_ps(a, _mm256_loadu_ps(w)));
        const __m256 right =
            _mm256_fmadd_ps(d, _mm256_loadu_ps(w + 3 * step), _mm256_mul_ps(c, _mm256_loadu_ps(w + 2 * step)));
        return _mm256_add_ps(left, right);
    }
};

void cell_row_by_8(const float* nodes, const float* weights, int step, float* out) {
    const FourNodes four(nodes);
    for (int i = 0; i < step; i += 8) _mm256_storeu_ps(out + i, four.between(weights + i, step));
}

template <int step>
void locate_narrow_cells(const float* weights, const RowOfCells& r, const Geometry& g, Block<uint8_t>* blocks) {
    const InnerLocator locator(g);
    for (int j = 0; j < r.count; ++j) {
        const FourNodes x(r.fine_x + j), y(r.fine_y + j);
        for (int i = 0; i < step; i += 8)
            locator.put(x.between(weights + i, step), y.between(weights + i, step), *blocks++);
    }
}

void locate_narrow_ring(const Polar& p, int row, int column, int count, const Geometry& g, Block<uint8_t>* blocks) {
    const InnerLocator locator(g);
    const __m256 radius = _mm256_set1_ps(p.radii[row] * FINE);
    const __m256 x = _mm256_set1_ps(p.x * FINE), y = _mm256_set1_ps(p.y * FINE);
    const float *cosines = p.cosines + column, *sines = p.sines + column;
    for (int i = 0; i < count; i += 8)
        locator.put(_mm256_fmadd_ps(radius, _mm256_loadu_ps(cosines + i), x),
                    _mm256_fmadd_ps(radius, _mm256_loadu_ps(sines + i), y), blocks[i / 8]);
}

// -- bilinear --------------------------------------------------------------------------------------

// Both neighbours of 4 pixels in one row: pixels 0 and 1 of offsets, and 4 and 5.
__m256i load_row(const uint8_t* row, const uint32_t* offsets) {
    return _mm256_set_m128i(load_pair(row + offsets[4], row + offsets[5]),
                            load_pair(row + offsets[0], row + offsets[1]));
}

template <int C>
__m256i pairs_of_channels() {
    const __m128i pairs = C == 3 ? _mm_setr_epi8(0, 3, 1, 4, 2, 5, 2, 5, 8, 11, 9, 12, 10, 13, 10, 13)
                                 : _mm_setr_epi8(0, 4, 1, 5, 2, 6, 3, 7, 8, 12, 9, 13, 10, 14, 11, 15);
    return twice(pairs);
}

// The bytes of pixels first, first + 1, first + 4 and first + 5 out of 8 that are in each half, 4 times two.
template <int first, bool as_words>
__m256i order_of_weights() {
    constexpr char a = first, b = a + 1, c = a + 4, d = c + 1;
    const auto upper = [](char i) { return as_words ? char{-1} : i; };  // words: the byte in the upper half
    return _mm256_setr_epi8(upper(a), a, upper(a), a, upper(a), a, upper(a), a, upper(b), b, upper(b), b, upper(b), b,
                            upper(b), b, upper(c), c, upper(c), c, upper(c), c, upper(c), c, upper(d), d, upper(d), d,
                            upper(d), d, upper(d), d);
}

__m256i load_fractions(const uint8_t* p) {
    int64_t fractions;
    std::memcpy(&fractions, p, 8);
    return _mm256_set1_epi64x(fractions);
}

// 8 pixels of 4 bytes, of which the first C are written.
template <int C>
struct Writer {
    __m256i order = kept(twice(_mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1)));
    __m256i together = kept(_mm256_setr_epi32(0, 1, 2, 4, 5, 6, 7, 7));

    void write(__m256i pixels, uint8_t* out) const {
        if constexpr (C == 4) {
            _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), pixels);
        } else {
            const __m256i whole = _mm256_permutevar8x32_epi32(_mm256_shuffle_epi8(pixels, order), together);
            store16(out, _mm256_castsi256_si128(whole));
            _mm_storel_epi64(reinterpret_cast<__m128i*>(out + 16), _mm256_extracti128_si256(whole, 1));
        }
    }
};

// Colour. See linear_pixel for the arithmetic.
template <int C>
struct Linear {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;  // the last offset from which 8 bytes of both rows can be read
    Writer<C> writer;
    __m256i pairs = kept(pairs_of_channels<C>());
    __m256i across_0 = kept(order_of_weights<0, false>()), across_2 = kept(order_of_weights<2, false>());
    __m256i down_0 = kept(order_of_weights<0, true>()), down_2 = kept(order_of_weights<2, true>());
    __m256i sign = kept(_mm256_set1_epi8(-128)), complement = kept(_mm256_set1_epi16(0x00ff));
    __m256i weight = kept(_mm256_set1_epi16(129 * 128)), one = kept(_mm256_set1_epi16(LINEAR_ONE));
    __m256i round = kept(_mm256_set1_epi16(256));

    explicit Linear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 8)) {}

    __m256i values(const uint8_t* row, const uint32_t* offsets) const {
        return _mm256_xor_si256(_mm256_shuffle_epi8(load_row(row, offsets), pairs), sign);
    }

    // 4 pixels' values less 128, in words. The fractions of 8 pixels are in both halves.
    __m256i sample_4(const uint32_t* offsets, __m256i fx, __m256i fy, __m256i across, __m256i down) const {
        const __m256i x = _mm256_xor_si256(_mm256_shuffle_epi8(fx, across), complement);
        const __m256i lower_weight = _mm256_mulhi_epu16(_mm256_shuffle_epi8(fy, down), weight);
        const __m256i upper_weight = _mm256_sub_epi16(one, lower_weight);
        const __m256i upper = _mm256_maddubs_epi16(x, values(data, offsets));
        const __m256i lower = _mm256_maddubs_epi16(x, values(data + row_step, offsets));
        const __m256i sum =
            _mm256_add_epi16(_mm256_mulhrs_epi16(upper, upper_weight), _mm256_mulhrs_epi16(lower, lower_weight));
        return _mm256_mulhrs_epi16(sum, round);
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m256i x = load_fractions(b.fx), y = load_fractions(b.fy);
        const __m256i first = sample_4(b.offsets, x, y, across_0, down_0);
        const __m256i second = sample_4(b.offsets + 2, x, y, across_2, down_2);
        writer.write(_mm256_xor_si256(_mm256_packs_epi16(first, second), sign), out);
    }
};

uint16_t load2(const uint8_t* p) {
    uint16_t pair;
    std::memcpy(&pair, p, 2);
    return pair;
}

// Both neighbours of 8 pixels of one channel.
__m128i load_grey(const uint8_t* row, const uint32_t* o) {
    __m128i a = _mm_cvtsi32_si128(load2(row + o[0])), b = _mm_cvtsi32_si128(load2(row + o[4]));
    a = _mm_insert_epi16(a, load2(row + o[1]), 1), b = _mm_insert_epi16(b, load2(row + o[5]), 1);
    a = _mm_insert_epi16(a, load2(row + o[2]), 2), b = _mm_insert_epi16(b, load2(row + o[6]), 2);
    a = _mm_insert_epi16(a, load2(row + o[3]), 3), b = _mm_insert_epi16(b, load2(row + o[7]), 3);
    return _mm_unpacklo_epi64(a, b);
}

template <>
struct Linear<1> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Linear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 2)) {}

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m128i sign = _mm_set1_epi8(-128), f = load8(b.fx);
        const __m128i x = _mm_xor_si128(_mm_unpacklo_epi8(f, f), _mm_set1_epi16(0x00ff));
        const __m128i lower_weight =
            _mm_mulhi_epu16(_mm_unpacklo_epi8(_mm_setzero_si128(), load8(b.fy)), _mm_set1_epi16(129 * 128));
        const __m128i upper_weight = _mm_sub_epi16(_mm_set1_epi16(LINEAR_ONE), lower_weight);
        const __m128i u = _mm_maddubs_epi16(x, _mm_xor_si128(load_grey(data, b.offsets), sign));
        const __m128i l = _mm_maddubs_epi16(x, _mm_xor_si128(load_grey(data + row_step, b.offsets), sign));
        const __m128i v = _mm_add_epi16(_mm_mulhrs_epi16(u, upper_weight), _mm_mulhrs_epi16(l, lower_weight));
        const __m128i values = _mm_mulhrs_epi16(v, _mm_set1_epi16(256));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(out), _mm_xor_si128(_mm_packs_epi16(values, values), sign));
    }
};

int load4(const uint8_t* p) {
    int four;
    std::memcpy(&four, p, 4);
    return four;
}

// Two channels, as of NV12's colours: both neighbours of a pixel are 4 bytes.
template <>
struct Linear<2> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;
    __m256i pairs = kept(twice(_mm_setr_epi8(0, 2, 1, 3, 4, 6, 5, 7, 8, 10, 9, 11, 12, 14, 13, 15)));
    __m256i across = kept(_mm256_setr_epi8(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 6, 6,
                                           6, 6, 7, 7, 7, 7));
    __m256i down = kept(_mm256_setr_epi8(-1, 0, -1, 0, -1, 1, -1, 1, -1, 2, -1, 2, -1, 3, -1, 3, -1, 4, -1, 4, -1, 5, -1,
                                         5, -1, 6, -1, 6, -1, 7, -1, 7));
    __m256i sign = kept(_mm256_set1_epi8(-128)), complement = kept(_mm256_set1_epi16(0x00ff));
    __m256i weight = kept(_mm256_set1_epi16(129 * 128)), one = kept(_mm256_set1_epi16(LINEAR_ONE));
    __m256i round = kept(_mm256_set1_epi16(256));

    explicit Linear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 4)) {}

    __m256i values(const uint8_t* row, const uint32_t* o) const {
        const __m256i pixels =
            _mm256_setr_epi32(load4(row + o[0]), load4(row + o[1]), load4(row + o[2]), load4(row + o[3]),
                              load4(row + o[4]), load4(row + o[5]), load4(row + o[6]), load4(row + o[7]));
        return _mm256_xor_si256(_mm256_shuffle_epi8(pixels, pairs), sign);
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m256i x = _mm256_xor_si256(_mm256_shuffle_epi8(load_fractions(b.fx), across), complement);
        const __m256i lower_weight = _mm256_mulhi_epu16(_mm256_shuffle_epi8(load_fractions(b.fy), down), weight);
        const __m256i upper_weight = _mm256_sub_epi16(one, lower_weight);
        const __m256i u = _mm256_maddubs_epi16(x, values(data, b.offsets));
        const __m256i l = _mm256_maddubs_epi16(x, values(data + row_step, b.offsets));
        const __m256i sum = _mm256_add_epi16(_mm256_mulhrs_epi16(u, upper_weight), _mm256_mulhrs_epi16(l, lower_weight));
        const __m256i words = _mm256_mulhrs_epi16(sum, round);
        const __m256i bytes = _mm256_xor_si256(_mm256_packs_epi16(words, words), sign);
        store16(out, _mm256_castsi256_si128(_mm256_permute4x64_epi64(bytes, 0x08)));
    }
};

// -- bicubic ---------------------------------------------------------------------------------------

void add_to(int32_t* sums, __m256i more) {
    _mm256_store_si256(reinterpret_cast<__m256i*>(sums), _mm256_add_epi32(load32(sums), more));
}

// The words of both halves: channels of taps 0 and 1 paired, and of taps 2 and 3; bytes in the upper half.
template <int C>
__m256i pairs_of_taps() {
    const auto half = [](char k) {
        const char a = k * C, b = a + C;
        constexpr char d = C == 4 ? 3 : 2, z = -1;
        return _mm_setr_epi8(z, a, z, b, z, a + 1, z, b + 1, z, a + 2, z, b + 2, z, a + d, z, b + d);
    };
    return _mm256_set_m128i(half(2), half(0));
}

// Colour. See cubic_sum for the arithmetic.
template <int C>
struct Cubic {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;  // the last offset from which the lowest row's 16 bytes can be read
    Writer<C> writer;
    __m256i order = kept(pairs_of_taps<C>());
    __m256i spread = kept(_mm256_setr_epi8(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 4, 5, 6, 7, 4, 5, 6, 7, 4, 5,
                                           6, 7, 4, 5, 6, 7));
    __m256i round = kept(_mm256_set1_epi32(1 << 19));

    explicit Cubic(const Source& s)
        : data(s.data),
          row_step(s.geometry.row_step),
          last(static_cast<uint32_t>(s.elements - 2 * row_step + C - 16)) {}

    __m256i weighted(const uint8_t* row, uint32_t magnitude) const {
        const __m256i values = _mm256_shuffle_epi8(twice(load16(row)), order);
        return _mm256_mulhi_epu16(values, _mm256_set1_epi32(static_cast<int>(magnitude)));
    }

    // Sums of one pixel, of taps 0 and 1 and of taps 2 and 3, with 20 bits after the point.
    __m256i halves(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const uint8_t* first = data + offset - row_step - C;
        const uint32_t* wy = CUBIC.magnitudes[fy];
        const __m256i minus = _mm256_add_epi16(weighted(first, wy[0]), weighted(first + 3 * row_step, wy[3]));
        const __m256i plus = _mm256_add_epi16(weighted(first + row_step, wy[1]), weighted(first + 2 * row_step, wy[2]));
        int64_t wx;
        std::memcpy(&wx, CUBIC.weights[fx], 8);
        return _mm256_madd_epi16(_mm256_sub_epi16(plus, minus), _mm256_shuffle_epi8(_mm256_set1_epi64x(wx), spread));
    }

    // Pixels i and i + 4, in 32 bits a channel.
    __m256i sum_2(const Block<uint8_t>& block, int i) const {
        const __m256i a = halves(block.offsets[i], block.fx[i], block.fy[i]);
        const __m256i b = halves(block.offsets[i + 4], block.fx[i + 4], block.fy[i + 4]);
        return _mm256_add_epi32(_mm256_permute2x128_si256(a, b, 0x20), _mm256_permute2x128_si256(a, b, 0x31));
    }

    void add_8(const Block<uint8_t>& b, int32_t* sums) const {
        for (int i = 0; i < 4; ++i) add_to(sums + 8 * i, _mm256_srai_epi32(sum_2(b, i), 13));
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const auto at = [&](int i) { return _mm256_srai_epi32(_mm256_add_epi32(sum_2(b, i), round), 20); };
        const __m256i first = _mm256_packs_epi32(at(0), at(1)), second = _mm256_packs_epi32(at(2), at(3));
        writer.write(_mm256_packus_epi16(first, second), out);
    }
};

// Grey: the 16 taps of a pixel fill one register.
template <>
struct Cubic<1> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Cubic(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - 2 * row_step + 1 - 4)) {}

    // Four sums of words that add up to one pixel.
    __m128i one_pixel(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const uint8_t* first = data + offset - row_step - 1;
        const __m128i bytes = _mm_setr_epi32(load4(first), load4(first + row_step), load4(first + 2 * row_step),
                                             load4(first + 3 * row_step));
        const __m256i values = _mm256_slli_epi16(_mm256_cvtepu8_epi16(bytes), 8);  // rows 0, 1 and rows 2, 3
        const __m256i rows = _mm256_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3);
        const __m256i wy = _mm256_permutevar8x32_epi32(twice(load16(CUBIC.magnitudes[fy])), rows);
        const __m256i weighted = _mm256_mulhi_epu16(values, wy);
        const __m128i low = _mm256_castsi256_si128(weighted), high = _mm256_extracti128_si256(weighted, 1);
        // rows 1 - 0 and 2 - 3
        const __m128i inner_rows = _mm_unpackhi_epi64(low, _mm_slli_si128(high, 8));
        const __m128i outer_rows = _mm_unpacklo_epi64(low, _mm_srli_si128(high, 8));
        const __m128i columns = _mm_sub_epi16(inner_rows, outer_rows);
        int64_t wx;
        std::memcpy(&wx, CUBIC.weights[fx], 8);
        return _mm_madd_epi16(columns, _mm_set1_epi64x(wx));
    }

    __m256i sum_8(const Block<uint8_t>& b) const {
        const auto at = [&](int i) { return one_pixel(b.offsets[i], b.fx[i], b.fy[i]); };
        const __m128i first = _mm_hadd_epi32(_mm_hadd_epi32(at(0), at(1)), _mm_hadd_epi32(at(2), at(3)));
        const __m128i second = _mm_hadd_epi32(_mm_hadd_epi32(at(4), at(5)), _mm_hadd_epi32(at(6), at(7)));
        return _mm256_set_m128i(second, first);
    }

    void add_8(const Block<uint8_t>& b, int32_t* sums) const { add_to(sums, _mm256_srai_epi32(sum_8(b), 13)); }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m256i sum = _mm256_srai_epi32(_mm256_add_epi32(sum_8(b), _mm256_set1_epi32(1 << 19)), 20);
        const __m128i words = _mm_packs_epi32(_mm256_castsi256_si128(sum), _mm256_extracti128_si256(sum, 1));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(out), _mm_packus_epi16(words, words));
    }
};

// Two channels: a row's taps are 8 bytes.
template <>
struct Cubic<2> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Cubic(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - 2 * row_step + 2 - 8)) {}

    static __m128i weighted(const uint8_t* row, uint32_t magnitude) {
        const __m128i values = _mm_unpacklo_epi8(_mm_setzero_si128(), load8(row));
        return _mm_mulhi_epu16(values, _mm_set1_epi32(static_cast<int>(magnitude)));
    }

    // Four sums of words: the first channel's two, and the second's.
    __m128i one_pixel(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const uint8_t* first = data + offset - row_step - 2;
        const uint32_t* wy = CUBIC.magnitudes[fy];
        const __m128i minus = _mm_add_epi16(weighted(first, wy[0]), weighted(first + 3 * row_step, wy[3]));
        const __m128i plus = _mm_add_epi16(weighted(first + row_step, wy[1]), weighted(first + 2 * row_step, wy[2]));
        const __m128i apart = _mm_setr_epi8(0, 1, 4, 5, 8, 9, 12, 13, 2, 3, 6, 7, 10, 11, 14, 15);
        int64_t wx;
        std::memcpy(&wx, CUBIC.weights[fx], 8);
        return _mm_madd_epi16(_mm_shuffle_epi8(_mm_sub_epi16(plus, minus), apart), _mm_set1_epi64x(wx));
    }

    __m128i sum_2(const Block<uint8_t>& b, int i) const {
        return _mm_hadd_epi32(one_pixel(b.offsets[i], b.fx[i], b.fy[i]),
                              one_pixel(b.offsets[i + 1], b.fx[i + 1], b.fy[i + 1]));
    }

    void add_8(const Block<uint8_t>& b, int32_t* sums) const {
        for (int i = 0; i < 8; i += 4)
            add_to(sums + 2 * i, _mm256_srai_epi32(_mm256_set_m128i(sum_2(b, i + 2), sum_2(b, i)), 13));
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m128i round = _mm_set1_epi32(1 << 19);
        const auto two = [&](int i) { return _mm_srai_epi32(_mm_add_epi32(sum_2(b, i), round), 20); };
        const __m128i first = _mm_packs_epi32(two(0), two(2)), second = _mm_packs_epi32(two(4), two(6));
        store16(out, _mm_packus_epi16(first, second));
    }
};

// -- strips ----------------------------------------------------------------------------------------

// Which of 8 pixels the fast kernel must not touch: outside, at an edge, or too near the end of the memory.
int unfit(const uint32_t* offsets, __m256i last) {
    const __m256i o = load32(offsets);
    const __m256i fit = _mm256_cmpeq_epi32(_mm256_max_epu32(o, last), last);
    return _mm256_movemask_ps(_mm256_castsi256_ps(fit)) ^ 0xff;
}

// 8 pixels of which some are unfit, or not wanted: count < 8. Apart, so that it takes no registers from the rest.
template <class Kernel, Interpolation I, int C>
[[gnu::noinline]] void sample_mixed(const Job& job, const Kernel& kernel, const Block<uint8_t>& b, int unfit_bits,
                                    int count, uint8_t* out) {
    uint8_t pixels[8 * C];
    if (unfit_bits != 0xff) {
        Block<uint8_t> fit = b;
        const uint32_t other = b.offsets[__builtin_ctz(~unfit_bits)];
        for (int i = 0; i < 8; ++i)
            if (unfit_bits >> i & 1) fit.offsets[i] = other;
        kernel.sample_8(fit, pixels);
    }
    for (int i = 0; i < count; ++i)
        if (unfit_bits >> i & 1) sample_pixel<I, C>(job, b.offsets[i], b.fx[i], b.fy[i], pixels + i * C);
    std::memcpy(out, pixels, static_cast<size_t>(count * C));
}

// Every second pixel of the upper row: more fetches cost more than they gain.
void fetch_ahead(const uint8_t* data, const uint32_t* offsets) {
    for (int i = 0; i < 8; i += 2)
        _mm_prefetch(reinterpret_cast<const char*>(data) + (offsets[i] & ~EDGE), _MM_HINT_T0);
}

template <class Kernel, Interpolation I, int C>
void sample_by_8(const Job& job, const Strip<uint8_t>& s) {
    const Kernel kernel(job.source);
    const __m256i last = _mm256_set1_epi32(static_cast<int>(kernel.last));
    for (int i = 0; i < s.count; i += 8) {
        const Block<uint8_t>& block = s.blocks[i / 8];
        const int bits = unfit(block.offsets, last), left = s.count - i;
        _mm_prefetch(reinterpret_cast<const char*>(&block) + 2048, _MM_HINT_T0);  // a packed map goes on there
        if (s.ahead) fetch_ahead(kernel.data, s.ahead[i / 8].offsets);
        if (__builtin_expect(!bits && left >= 8, 1))
            kernel.sample_8(block, s.out + i * C);
        else
            sample_mixed<Kernel, I, C>(job, kernel, block, bits, smaller(left, 8), s.out + i * C);
    }
}

// Means in 32 bits, of 8 sums.
__m256i means(const int32_t* sums, float scale) {
    const __m256 values = _mm256_mul_ps(_mm256_cvtepi32_ps(load32(sums)), _mm256_set1_ps(scale));
    return _mm256_cvttps_epi32(_mm256_add_ps(_mm256_max_ps(values, _mm256_setzero_ps()), _mm256_set1_ps(0.5f)));
}

template <int C>
void mean_by_8(const int32_t* sums, int count, uint8_t* out) {
    const float scale = 1 / (SUM_ONE * static_cast<float>(count));
    const auto words = [](__m256i values) {
        return _mm_packs_epi32(_mm256_castsi256_si128(values), _mm256_extracti128_si256(values, 1));
    };
    if constexpr (C == 1) {
        const __m128i values = words(means(sums, scale));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(out), _mm_packus_epi16(values, values));
    } else if constexpr (C == 2) {
        store16(out, _mm_packus_epi16(words(means(sums, scale)), words(means(sums + 8, scale))));
    } else {
        const __m256i first = _mm256_packs_epi32(means(sums, scale), means(sums + 8, scale));
        const __m256i second = _mm256_packs_epi32(means(sums + 16, scale), means(sums + 24, scale));
        Writer<C>().write(_mm256_packus_epi16(first, second), out);
    }
}

struct Avx2 {
    static void cell_row(const float* x_nodes, const float* y_nodes, const float* weights, int step, float* x,
                         float* y) {
        cell_row_by_8(x_nodes, weights, step, x);
        cell_row_by_8(y_nodes, weights, step, y);
    }

    template <Interpolation I, class F>
    static constexpr bool has_fractions_of_8 = sizeof(F) == 1 && I != Interpolation::nearest;

    template <Interpolation I, class Real, class F>
    static void locate(const Real* x, const Real* y, int count, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>)
            locate_by_8<I>(x, y, count, g, blocks);
        else
            Plain::locate<I>(x, y, count, g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_cells(const Nodes& n, const RowOfCells& r, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>) {
            if (is_narrow(g) && r.step == 16) return locate_narrow_cells<16>(n.weights, r, g, blocks);
            if (is_narrow(g) && r.step == 8) return locate_narrow_cells<8>(n.weights, r, g, blocks);
        }
        Plain::locate_inner_cells<I>(n, r, g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_ring(const Polar& p, int row, int column, int count, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>) {
            if (is_narrow(g)) return locate_narrow_ring(p, row, column, count, g, blocks);
        }
        Plain::locate_inner_ring<I>(p, row, column, count, g, blocks);
    }

    template <Interpolation I, int C, class T>
    static void sample_strip(const Job& job, const Strip<Fraction<T>>& s) {
        if constexpr (sizeof(T) == 1 && I == Interpolation::linear)
            sample_by_8<Linear<C>, I, C>(job, s);
        else if constexpr (sizeof(T) == 1 && I == Interpolation::cubic)
            sample_by_8<Cubic<C>, I, C>(job, s);
        else
            Plain::sample_strip<I, C, T>(job, s);
    }
};

struct Avx2Sums {
    template <int C, class T>
    static void add_taps(const Source& source, const Block<Fraction<T>>* blocks, int count, Sum<T>* sums,
                         uint16_t* inside) {
        if constexpr (sizeof(T) == 1) {
            const Cubic<C> kernel(source);
            const __m256i last = _mm256_set1_epi32(static_cast<int>(kernel.last));
            for (int i = 0; i < count; i += 8) {
                if (unfit(blocks[i / 8].offsets, last)) {
                    add_8_taps<C, T>(source, blocks[i / 8], sums + i * CHANNELS_OF_SUMS<C>, inside + i);
                    continue;
                }
                kernel.add_8(blocks[i / 8], sums + i * CHANNELS_OF_SUMS<C>);
                auto* counts = reinterpret_cast<__m128i*>(inside + i);
                _mm_storeu_si128(counts, _mm_add_epi16(load16(counts), _mm_set1_epi16(1)));
            }
        } else {
            PlainSums::add_taps<C, T>(source, blocks, count, sums, inside);
        }
    }

    template <int C, class T>
    static void mean_of_8(const Sum<T>* sums, int count, T* out) {
        if constexpr (sizeof(T) == 1)
            mean_by_8<C>(sums, count, out);
        else
            PlainSums::mean_of_8<C, T>(sums, count, out);
    }
};

}  // namespace

const Kernels avx2_kernels{"avx2", &sample<Avx2>, &average<Avx2, Avx2Sums>, &pack<Avx2>, &project_targets};

}  // namespace omnimirror
