#include "tools/maps/live_map.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <Eigen/Geometry>

#include "slam/map/map.h"

namespace waymark::tools {
namespace {

// Anybody can send on a channel, so what comes is checked before it is used.
std::optional<io::MarkerCorners> markerCorners(const marker_t& m) {
  const Eigen::Quaterniond q(m.q_w_m[0], m.q_w_m[1], m.q_w_m[2], m.q_w_m[3]);
  const Eigen::Vector3d p(m.p_w_m[0], m.p_w_m[1], m.p_w_m[2]);
  constexpr double kOffUnit = 1e-3;
  if (m.id < 0 || !(m.size > 0.0) || !std::isfinite(m.size) || !p.allFinite() ||
      !(std::abs(q.norm() - 1.0) < kOffUnit)) {
    return std::nullopt;
  }
  const slam::Transform T_w_m = slam::Transform::fromQuaternion(q, p);
  io::MarkerCorners marker{m.id, m.size, slam::markerCorners(m.size)};
  for (Eigen::Vector3d& corner : marker.corners) corner = T_w_m * corner;
  return marker;
}

}  // namespace

bool LiveMap::add(const map_t& piece) {
  if (piece.piece < 0 || piece.piece >= piece.piece_count) return false;
  std::vector<io::MarkerCorners> markers;
  for (const marker_t& marker : piece.markers) {
    const std::optional<io::MarkerCorners> corners = markerCorners(marker);
    if (!corners) return false;
    markers.push_back(*corners);
  }

  if (piece.revision != revision_) pieces_.clear();
  revision_ = piece.revision;
  pieces_[piece.piece] = std::move(markers);
  if (std::cmp_less(pieces_.size(), piece.piece_count)) return true;

  markers_.clear();
  for (const auto& [number, part] : pieces_) {
    markers_.insert(markers_.end(), part.begin(), part.end());
  }
  std::ranges::sort(markers_, {}, &io::MarkerCorners::id);
  return true;
}

}  // namespace waymark::tools
