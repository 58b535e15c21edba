#include "trials.hpp"


#include "pool.hpp"
#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int TRIALS_PER_TASK = 64;

// Uses the instruction set selected for the samplers, or the plain kernel if there is none for it.
TrialKernel trial_kernel() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_trials;
#endif
    return plain_trials;
}

}  // namespace

bool is_valid_term_count(int terms) { return terms == 0 || terms == 4 || terms == 8 || terms == 16; }

bool is_valid_power_count(int powers) { return powers == 1 || powers == 15 || powers == 28 || powers == 91; }

void evaluate_trials(const TrialJob& job) {
    TrialJob copy = job;
    parallel_for((job.evaluate_trials_binding + TRIALS_PER_TASK - 1) / TRIALS_PER_TASK,
                 [](void* context, int i) {
                     const auto& work = *static_cast<const TrialJob*>(context);
                     const int first = i * TRIALS_PER_TASK, rest = work.evaluate_trials_binding - first;
                     trial_kernel()(work, first, rest < TRIALS_PER_TASK ? rest : TRIALS_PER_TASK);
                 },
                 &copy);
}

}  // namespace omnimirror
