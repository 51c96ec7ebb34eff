#include "slam/detection/quads/known_quads.h"

#include <algorithm>
#include <cmath>

#include "slam/geometry/plane.h"

namespace waymark::slam {
namespace {

constexpr std::size_t kFirstSlots = 256;  // a power of two, as always
// Cells of the grid, in distances of same corners: few quads share one, and one lookup is mostly
// within one.
constexpr double kCellSize = 4.0;

}  // namespace

KnownQuads::KnownQuads(double same_corner_px)
    : same_corner_px_(same_corner_px),
      cell_px_(kCellSize * same_corner_px),
      first_(kFirstSlots, -1) {}

void KnownQuads::clear() {
  std::ranges::fill(first_, -1);
  entries_.clear();
  compared_ = 0;
}

void KnownQuads::add(const Quad& quad) {
  if (entries_.size() == first_.size()) grow();
  entries_.push_back({quad, -1});
  link(static_cast<std::int32_t>(entries_.size()) - 1);
}

// The centres of two quads are as near to each other as their corners.
bool KnownQuads::contains(const Quad& quad) {
  const Eigen::Vector2d centre = centreOf(quad);
  const std::int64_t left = cellOf(centre.x() - same_corner_px_);
  const std::int64_t right = cellOf(centre.x() + same_corner_px_);
  const std::int64_t top = cellOf(centre.y() - same_corner_px_);
  const std::int64_t bottom = cellOf(centre.y() + same_corner_px_);
  for (std::int64_t row = top; row <= bottom; ++row) {
    for (std::int64_t column = left; column <= right; ++column) {
      if (slotContains(slotOf(column, row), quad)) return true;
    }
  }
  return false;
}

std::int64_t KnownQuads::cellOf(double coordinate) const {
  return static_cast<std::int64_t>(std::floor(coordinate / cell_px_));
}

std::size_t KnownQuads::slotOf(std::int64_t column, std::int64_t row) const {
  const std::uint64_t mixed = static_cast<std::uint64_t>(column) * 0x9E3779B97F4A7C15U +
                              static_cast<std::uint64_t>(row) * 0xC2B2AE3D27D4EB4FU;
  return static_cast<std::size_t>(mixed >> 32U) & (first_.size() - 1);
}

bool KnownQuads::slotContains(std::size_t slot, const Quad& quad) {
  for (std::int32_t i = first_[slot]; i >= 0; i = entries_[static_cast<std::size_t>(i)].next) {
    ++compared_;
    if (isSame(quad, entries_[static_cast<std::size_t>(i)].quad)) return true;
  }
  return false;
}

bool KnownQuads::isSame(const Quad& quad, const Quad& known) const {
  return std::ranges::all_of(quad, [&](const Eigen::Vector2d& corner) {
    return std::ranges::any_of(known, [&](const Eigen::Vector2d& other) {
      return (corner - other).squaredNorm() < same_corner_px_ * same_corner_px_;
    });
  });
}

void KnownQuads::grow() {
  first_.assign(2 * first_.size(), -1);
  for (std::size_t i = 0; i < entries_.size(); ++i) link(static_cast<std::int32_t>(i));
}

void KnownQuads::link(std::int32_t index) {
  Entry& entry = entries_[static_cast<std::size_t>(index)];
  const Eigen::Vector2d centre = centreOf(entry.quad);
  std::int32_t& first = first_[slotOf(cellOf(centre.x()), cellOf(centre.y()))];
  entry.next = first;
  first = index;
}

}  // namespace waymark::slam
