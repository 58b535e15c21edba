// Kernels for x86 with AVX2.
#include "avx2_strips.hpp"
#include "axial_kernel.hpp"

namespace omnimirror {

const Kernels avx2_kernels{"avx2", Level::AVX2, &sample<Avx2>, &average<Avx2, Avx2Sums>, &pack<Avx2>, &project_targets};

}  // namespace omnimirror
