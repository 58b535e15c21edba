#include "exposure.hpp"

#include <cstring>

#include "pool.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

// The samplers choose the instructions; those without kernels here take the plain ones.
const ExposureKernels& exposure_kernels() {
#if defined(OMNIMIRROR_AVX2)
    if (!std::strcmp(kernels().name, avx2_exposure.name)) return avx2_exposure;
#endif
    return plain_exposure;
}

struct LightWork {
    const Exposure& exposure;
    const Environment& world;
    int top;
    float* light;
};

struct RayWork {
    const Exposure& exposure;
    int top;
    RayOut out;
};

}  // namespace

void expose(const Exposure& exposure, const Environment& world, int top, int count, float* light) {
    LightWork work{exposure, world, top, light};
    parallel_for(
        count,
        [](void* context, int i) {
            const auto& w = *static_cast<const LightWork*>(context);
            exposure_kernels().light(w.exposure, w.world, w.top + i, w.light + int64_t{3} * w.exposure.width * i);
        },
        &work);
}

void expose(const Exposure& exposure, int top, int count, const RayOut& out) {
    RayWork work{exposure, top, out};
    parallel_for(
        count,
        [](void* context, int i) {
            const auto& w = *static_cast<const RayWork*>(context);
            const int64_t n = int64_t{w.exposure.width} * w.exposure.samples.count * i;
            exposure_kernels().rays(w.exposure, w.top + i,
                                    {w.out.origins + 3 * n, w.out.directions + 3 * n, w.out.weights + n,
                                     w.out.fates + n});
        },
        &work);
}

}  // namespace omnimirror
