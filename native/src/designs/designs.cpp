#include "designs.hpp"


#include "pool.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int DESIGNS_A_PIECE = 32;

// Uses the instruction set selected for the samplers, or the plain kernel if there is none for it.
DesignKernel design_kernel() {
#if defined(OMNIMIRROR_AVX512)
    if (kernels().level >= Level::AVX512) return avx512_designs;
#endif
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_designs;
#endif
    return plain_designs;
}

}  // namespace

void evaluate_designs(const DesignJob& job) {
    DesignJob copy = job;
    parallel_for(
        (job.designs + DESIGNS_A_PIECE - 1) / DESIGNS_A_PIECE,
        [](void* context, int i) {
            const auto& work = *static_cast<const DesignJob*>(context);
            const int first = i * DESIGNS_A_PIECE, rest = work.designs - first;
            design_kernel()(work, first, rest < DESIGNS_A_PIECE ? rest : DESIGNS_A_PIECE);
        },
        &copy);
}

}  // namespace omnimirror
