#include "shell_transmission.hpp"

#include "batches.hpp"
#include "shell_rays.hpp"

namespace omnimirror {
namespace {

constexpr int RAYS_PER_TASK = 4096;

Vector<double> of(const double* row) { return {row[0], row[1], row[2]}; }
void store(double* row, Vector<double> v) { row[0] = v.x, row[1] = v.y, row[2] = v.z; }

void trace_one(const ShellJob& job, long i) {
    const Vector<double> towards = of(job.directions + 3 * i);
    const double size = std::sqrt(dot(towards, towards));
    const Vector<double> d{towards.x / size, towards.y / size, towards.z / size};
    const ShellExit<double> exit_ray = trace_shell(job.shell, of(job.points + 3 * i), d);
    store(job.vectors[0] + 3 * i, exit_ray.exit_point);
    store(job.vectors[1] + 3 * i, exit_ray.outwards);
    store(job.vectors[2] + 3 * i, exit_ray.inner_point);
    store(job.vectors[3] + 3 * i, d);
    store(job.vectors[4] + 3 * i, exit_ray.inwards);
    job.numbers[0][i] = exit_ray.before, job.numbers[1][i] = exit_ray.within;
    job.numbers[2][i] = exit_ray.cosine_before, job.numbers[3][i] = exit_ray.cosine_behind;
    job.meets[i] = exit_ray.meets, job.passes[i] = exit_ray.passes;
}

void trace_batch(const ShellJob& job, long first, int count) {
    for (long i = first; i < first + count; ++i) trace_one(job, i);
}

}  // namespace

void shell_exit(const ShellJob& job) { in_batches(job, RAYS_PER_TASK, trace_batch); }

}  // namespace omnimirror
