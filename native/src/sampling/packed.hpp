// A map that is built once, for repeated images of one size.
#pragma once

#include <memory>
#include <mutex>
#include <vector>

#include "job.hpp"
#include "large_pages.hpp"
#include "sample.hpp"

namespace omnimirror {

class PackedMap {
  public:
    PackedMap(const Coordinates& coordinates, int rows, int columns, int width, int height, int channels, bool is_deep,
              Interpolation interpolation);

    int rows() const { return rows_; }
    int columns() const { return columns_; }
    int width() const { return width_; }
    int height() const { return height_; }
    int channels() const { return channels_; }
    bool is_deep() const { return is_deep_; }
    Interpolation interpolation() const { return interpolation_; }
    size_t bytes() const { return blocks_->size(); }

    // Blocks for images whose rows are row_step elements apart; cached until another step is requested.
    using Blocks = std::vector<uint8_t, LargePages<uint8_t>>;
    std::shared_ptr<const Blocks> blocks_for(uint32_t row_step) const;
    Packed packed(const Blocks& blocks) const { return {blocks.data(), rows_, columns_}; }

  private:
    int rows_, columns_, width_, height_, channels_;
    bool is_deep_;
    Interpolation interpolation_;
    uint32_t own_row_step_;
    std::shared_ptr<Blocks> blocks_;
    mutable std::mutex mutex_;  // guards the two members below
    mutable uint32_t other_row_step_ = 0;
    mutable std::shared_ptr<Blocks> other_blocks_;
};

}  // namespace omnimirror
