#include "packed.hpp"

#include <algorithm>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr int ROWS_AT_A_TIME = 16;

struct Work {
    const Packing& packing;
    const Kernels& kernels;
    int rows;
};

void pack_some_rows(void* context, int index) {
    const Work& work = *static_cast<const Work*>(context);
    const int top = index * ROWS_AT_A_TIME;
    work.kernels.pack(work.packing, top, std::min(top + ROWS_AT_A_TIME, work.rows));
}

uint32_t moved(uint32_t offset, uint32_t from, uint32_t to) {
    if (offset == OUTSIDE) return offset;
    const uint32_t place = offset & ~EDGE;
    return (place / from * to + place % from) | (offset & EDGE);
}

}  // namespace

PackedMap::PackedMap(const Coordinates& coordinates, int rows, int columns, int width, int height, int channels,
                     bool is_deep, Interpolation interpolation)
    : rows_(rows), columns_(columns), width_(width), height_(height), channels_(channels), deep_(is_deep),
      interpolation_(interpolation), row_entries_((columns + 7) & ~7) {
    const Geometry geometry = geometry_of(width, height, channels, int64_t{width} * channels, interpolation);
    own_row_step_ = geometry.row_step;
    const size_t entries = static_cast<size_t>(rows) * static_cast<size_t>(row_entries_);
    offsets_ = std::make_shared<std::vector<uint32_t>>(entries);
    fx_.resize(entries * (is_deep ? 2 : 1));
    fy_.resize(fx_.size());
    const Packing packing{coordinates, geometry, interpolation, columns, is_deep, offsets_->data(), fx_.data(),
                          fy_.data(), row_entries_};
    Work work{packing, kernels(), rows};
    parallel_for((rows + ROWS_AT_A_TIME - 1) / ROWS_AT_A_TIME, &pack_some_rows, &work);
}

size_t PackedMap::bytes() const { return offsets_->size() * 4 + fx_.size() + fy_.size(); }

std::shared_ptr<const std::vector<uint32_t>> PackedMap::offsets_for(uint32_t row_step) const {
    if (row_step == own_row_step_) return offsets_;
    std::lock_guard lock(mutex_);
    if (row_step != other_row_step_) {
        auto other = std::make_shared<std::vector<uint32_t>>(offsets_->size());
        std::transform(offsets_->begin(), offsets_->end(), other->begin(),
                       [&](uint32_t offset) { return moved(offset, own_row_step_, row_step); });
        other_offsets_ = other, other_row_step_ = row_step;
    }
    return other_offsets_;
}

Packed PackedMap::packed(const std::vector<uint32_t>& offsets) const {
    return {offsets.data(), fx_.data(), fy_.data(), row_entries_};
}

}  // namespace omnimirror
