// The quads found so far, by their place: whether one more is there already is known without a look
// at all of them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include <Eigen/Core>

#include "slam/detection/quads/region_quad.h"

namespace waymark::slam {

class KnownQuads {
 public:
  // Two quads are the same where each corner of one is within same_corner_px of one of the other.
  explicit KnownQuads(double same_corner_px);

  void clear();
  void add(const Quad& quad);
  [[nodiscard]] bool contains(const Quad& quad);

  // Quads that contains() has compared since clear().
  [[nodiscard]] int compared() const { return compared_; }

 private:
  struct Entry {
    Quad quad;
    std::int32_t next;  // of the same slot; -1 at the end
  };

  [[nodiscard]] std::int64_t cellOf(double coordinate) const;
  [[nodiscard]] std::size_t slotOf(std::int64_t column, std::int64_t row) const;
  [[nodiscard]] bool slotContains(std::size_t slot, const Quad& quad);
  [[nodiscard]] bool isSame(const Quad& quad, const Quad& known) const;
  void grow();
  void link(std::int32_t index);

  double same_corner_px_;
  double cell_px_;
  std::vector<std::int32_t> first_;  // by slot, an index into entries_; -1: none
  std::vector<Entry> entries_;
  int compared_ = 0;
};

}  // namespace waymark::slam
