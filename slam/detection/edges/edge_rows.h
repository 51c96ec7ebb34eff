// Pixels near an edge, in rows that cross it: as many samples in every row, eight rows side by side
// as vectorized loops want them.
#pragma once

#include <array>
#include <cstddef>

#include "slam/detection/edges/lanes.h"

namespace waymark::slam {

// One row of pixels across the edge. Distances in pixels. A sample's distances change linearly from
// one to the next; all else is as where the row meets the first guess of the edge.
struct EdgeRow {
  float t = 0.5F;           // along the edge, 0 at its start, 1 at its end
  float distance = 0.0F;    // of the first sample from the first guess of the edge, outwards
  float step = 0.0F;        // from one sample to the next
  float innermost = 1.0F;   // only samples between these distances count:
  float outermost = -1.0F;  // none in a row made by default
  float to_start = 0.0F;    // of the first sample from the side that meets the edge at its start
  float to_end = 0.0F;      // likewise at its end
  float thickness = 1.0F;   // of the black border
  float ring_white = 0.0F;  // how white the code cell behind the border is, 0 .. 1
};

class EdgeRows {
 public:
  static constexpr std::size_t kMaxRows = 64;  // a multiple of kLanes
  static constexpr std::size_t kMaxAcross = 32;
  using Field = std::array<float, kMaxRows>;

  // By row.
  alignas(32) Field t, distance, step, innermost, outermost, to_start, to_end, thickness,
      ring_white;
  // What one sample is nearer to those sides than the one before it in its row: the same everywhere
  // along an edge.
  float to_start_step = 0.0F;
  float to_end_step = 0.0F;

  // So many rows, and some in which nothing counts, up to whole lanes: whoever fills the fields
  // calls ignorePadding() then. Preconditions: rows <= kMaxRows, 0 < across <= kMaxAcross.
  void resize(std::size_t rows, std::size_t across) {
    given_ = rows;
    rows_ = (rows + kLanes - 1) / kLanes * kLanes;
    across_ = across;
  }
  // Precondition: i is less than what resize() was given.
  void set(std::size_t i, const EdgeRow& row) {
    t[i] = row.t;
    distance[i] = row.distance;
    step[i] = row.step;
    innermost[i] = row.innermost;
    outermost[i] = row.outermost;
    to_start[i] = row.to_start;
    to_end[i] = row.to_end;
    thickness[i] = row.thickness;
    ring_white[i] = row.ring_white;
  }
  void ignorePadding() {
    for (std::size_t i = given_; i < rows_; ++i) {
      set(i, {});
      for (std::size_t k = 0; k < across_; ++k) setGrey(i, k, 0.0F);
    }
  }
  void setGrey(std::size_t row, std::size_t sample, float level) {
    grey_[index(row, sample)] = level;
  }
  [[nodiscard]] float greyAt(std::size_t row, std::size_t sample) const {
    return grey_[index(row, sample)];
  }
  // With the padding.
  [[nodiscard]] std::size_t rows() const { return rows_; }
  [[nodiscard]] std::size_t across() const { return across_; }
  // Of kLanes rows from `row` on, one sample each after the other.
  [[nodiscard]] const float* grey(std::size_t row) const { return grey_.data() + row * across_; }

 private:
  [[nodiscard]] std::size_t index(std::size_t row, std::size_t sample) const {
    return (row / kLanes * across_ + sample) * kLanes + row % kLanes;
  }

  std::size_t given_ = 0;  // rows without the padding
  std::size_t rows_ = 0;
  std::size_t across_ = 1;
  alignas(32) std::array<float, kMaxRows * kMaxAcross> grey_{};
};

}  // namespace waymark::slam
