#include "reflection.hpp"

#include "pool.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int RAYS_A_PIECE = 4096;

// The samplers choose the instructions; those without a kernel here take the plain one.
const ReflectionKernel& reflection_kernel() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_reflections;
#endif
    return plain_reflections;
}

template <class Job>
struct Work {
    const Job& job;
    void (*kernel)(const Job& job, long first, int count);
};

template <class Job>
void in_pieces(Work<Job> work) {
    parallel_for(
        static_cast<int>((work.job.count + RAYS_A_PIECE - 1) / RAYS_A_PIECE),
        [](void* context, int i) {
            const auto& [job, kernel] = *static_cast<const Work<Job>*>(context);
            const long first = static_cast<long>(i) * RAYS_A_PIECE, rest = job.count - first;
            kernel(job, first, static_cast<int>(rest < RAYS_A_PIECE ? rest : RAYS_A_PIECE));
        },
        &work);
}

}  // namespace

void find_reflections(const SeenJob& job) { in_pieces<SeenJob>({job, reflection_kernel().find}); }

void meet_mirror(const MetJob& job) { in_pieces<MetJob>({job, reflection_kernel().meet}); }

}  // namespace omnimirror
