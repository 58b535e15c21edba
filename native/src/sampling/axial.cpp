#include "axial.hpp"

#include <algorithm>
#include <utility>

#include "pool.hpp"
#include "sample.hpp"

namespace omnimirror {
namespace {

constexpr int64_t TARGETS_PER_TASK = 512;

struct Work {
    const Axial& camera;
    const Targets& targets;
    const Kernels& kernels;
};

void project_task(void* context, int index) {
    const Work& work = *static_cast<const Work*>(context);
    const int64_t first = index * TARGETS_PER_TASK;
    work.kernels.project(work.camera, work.targets, first, std::min(first + TARGETS_PER_TASK, work.targets.count));
}

}  // namespace

AxialCamera::AxialCamera(const Axial& camera, std::vector<double> radii, std::vector<double> origins)
    : radii_(std::move(radii)), origins_(std::move(origins)), camera_(camera) {
    const double reach = camera.last - camera.first;
    camera_.radii = radii_.data(), camera_.radii_last = static_cast<int>(radii_.size()) - 2;
    camera_.radii_per = static_cast<double>(radii_.size() - 1) / reach;
    if (origins_.empty()) return;
    camera_.origins = origins_.data(), camera_.origins_last = static_cast<int>(origins_.size() / 2) - 2;
    camera_.origins_per = static_cast<double>(origins_.size() / 2 - 1) / reach;
}

void AxialCamera::project(const Targets& targets) const {
    Work work{camera_, targets, kernels()};
    parallel_for(static_cast<int>((targets.count + TARGETS_PER_TASK - 1) / TARGETS_PER_TASK), &project_task, &work);
}

}  // namespace omnimirror
