// Kernels for x86 with AVX-512, including VBMI: bilinear samples, and source coordinates of inner cells and rings. The
// other kernels, which do not gain from 64-byte vectors, are those of AVX2, compiled for more registers.
#include <type_traits>

#include "avx2_strips.hpp"
#include "avx512_linear.hpp"
#include "avx512_locate.hpp"
#include "axial_kernel.hpp"

namespace omnimirror {
namespace {

template <class Kernel, int C>
void sample_by_16(const Job& job, const Strip<uint8_t>& s) {
    const Kernel kernel(job.source);
    const __m512i last = in_register(_mm512_set1_epi32(static_cast<int>(kernel.last)));
    for (int i = 0; i < s.count; i += 16) {
        const Block<uint8_t>* blocks = s.blocks + i / 8;
        const Block<uint8_t>* prefetched = s.prefetched ? s.prefetched + i / 8 : nullptr;
        const int left = s.count - i;
        _mm_prefetch(reinterpret_cast<const char*>(blocks) + 2048, _MM_HINT_T0);  // a packed map continues there
        _mm_prefetch(reinterpret_cast<const char*>(blocks) + 2048 + 64, _MM_HINT_T0);
        if (__builtin_expect(left < 16 || _mm512_cmpgt_epu32_mask(offsets_of(blocks), last), 0)) {
            sample_by_8<Linear<C>, Interpolation::linear, C>(job,
                                                             {blocks, min_of(left, 16), s.out + i * C, prefetched});
            continue;
        }
        if (prefetched)
            prefetch_source(kernel.data, prefetched[0].offsets), prefetch_source(kernel.data, prefetched[1].offsets);
        kernel.sample_16(blocks, s.out + i * C);
    }
}

template <class Fetch>
struct Avx512 : Avx2 {
    template <Interpolation I, class F>
    static void locate_inner_cells(const Lattice& n, const CellRow& r, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>) {
            if (is_narrow(g) && r.step == 32) return locate_wide_cells<32>(n.weights, r, g, blocks);
            if (is_narrow(g) && r.step == 16) return locate_wide_cells<16>(n.weights, r, g, blocks);
        }
        Avx2::locate_inner_cells<I>(n, r, g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_ring(const Polar& p, int row, int column, int count, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>) {
            if (is_narrow(g)) return locate_wide_ring(p, row, column, count, g, blocks);
        }
        Avx2::locate_inner_ring<I>(p, row, column, count, g, blocks);
    }

    template <Interpolation I, int C, class T>
    static void sample_strip(const Job& job, const Strip<Fraction<T>>& s) {
        constexpr bool is_wide = C > 2 || std::is_same_v<Fetch, Gathered>;
        if constexpr (sizeof(T) == 1 && I == Interpolation::linear && is_wide)
            sample_by_16<WideLinear<Fetch, C>, C>(job, s);
        else
            Avx2::sample_strip<I, C, T>(job, s);
    }
};

}  // namespace

const Kernels avx512_kernels{"avx512", Level::AVX512, &sample<Avx512<Loaded>>, &average<Avx512<Loaded>, Avx2Sums>,
                             &pack<Avx512<Loaded>>, &project_targets};
// The two sets differ only in their samplers.
const Kernels avx512_gather_kernels{"avx512-gather",
                                    Level::AVX512,
                                    &sample<Avx512<Gathered>>,
                                    &average<Avx512<Loaded>, Avx2Sums>,
                                    &pack<Avx512<Loaded>>,
                                    &project_targets};

}  // namespace omnimirror
