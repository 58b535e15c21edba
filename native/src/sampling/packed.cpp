#include "packed.hpp"

#include <algorithm>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr int ROWS_PER_TASK = 16;

struct Work {
    const Packing& packing;
    const Kernels& kernels;
    int rows;
};

void pack_task(void* context, int index) {
    const Work& work = *static_cast<const Work*>(context);
    const int top = index * ROWS_PER_TASK;
    work.kernels.pack(work.packing, top, std::min(top + ROWS_PER_TASK, work.rows));
}

uint32_t with_row_step(uint32_t offset, uint32_t from, uint32_t to) {
    if (offset == OUTSIDE) return offset;
    const uint32_t place = offset & ~EDGE;
    return (place / from * to + place % from) | (offset & EDGE);
}

template <class F>
void set_row_step(PackedMap::Blocks& blocks, uint32_t from, uint32_t to) {
    auto* first = reinterpret_cast<Block<F>*>(blocks.data());
    for (auto* block = first; block != first + blocks.size() / sizeof(Block<F>); ++block)
        for (uint32_t& offset : block->offsets) offset = with_row_step(offset, from, to);
}

}  // namespace

PackedMap::PackedMap(const Coordinates& coordinates, int rows, int columns, int width, int height, int channels,
                     bool is_deep, Interpolation interpolation)
    : rows_(rows),
      columns_(columns),
      width_(width),
      height_(height),
      channels_(channels),
      is_deep_(is_deep),
      interpolation_(interpolation) {
    const Geometry geometry = geometry_of(width, height, channels, int64_t{width} * channels, interpolation);
    own_row_step_ = geometry.row_step;
    const size_t entries = static_cast<size_t>(rows) * static_cast<size_t>((columns + 7) / 8);
    blocks_ = std::make_shared<Blocks>(entries * (is_deep ? sizeof(Block<uint16_t>) : sizeof(Block<uint8_t>)));
    const Packing packing{coordinates, geometry, interpolation, columns, is_deep, rows, blocks_->data()};
    Work work{packing, kernels(), rows};
    parallel_for((rows + ROWS_PER_TASK - 1) / ROWS_PER_TASK, &pack_task, &work);
}

std::shared_ptr<const PackedMap::Blocks> PackedMap::blocks_for(uint32_t row_step) const {
    if (row_step == own_row_step_) return blocks_;
    std::lock_guard lock(mutex_);
    if (row_step != other_row_step_) {
        auto other = std::make_shared<Blocks>(*blocks_);
        if (is_deep_)
            set_row_step<uint16_t>(*other, own_row_step_, row_step);
        else
            set_row_step<uint8_t>(*other, own_row_step_, row_step);
        other_blocks_ = other, other_row_step_ = row_step;
    }
    return other_blocks_;
}

}  // namespace omnimirror
