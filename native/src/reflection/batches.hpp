// Division of the jobs of this folder into tasks of the thread pool.
#pragma once

#include "pool.hpp"

namespace omnimirror {

// Call some(job, first, count) for batches of the job.count items.
template <class Job>
void in_batches(const Job& job, int size, void (*task)(const Job& job, long first, int count)) {
    struct Work {
        const Job& job;
        int size;
        void (*task)(const Job& job, long first, int count);
    } work{job, size, task};
    parallel_for(
        static_cast<int>((job.count + size - 1) / size),
        [](void* context, int piece) {
            const auto& [whole, length, run] = *static_cast<const Work*>(context);
            const long first = static_cast<long>(piece) * length, rest = whole.count - first;
            run(whole, first, static_cast<int>(rest < length ? rest : length));
        },
        &work);
}

}  // namespace omnimirror
