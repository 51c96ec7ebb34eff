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

std::vector<io::MarkerCorners> LiveMap::markers(int map_piece) const {
  const auto world = worlds_.find(map_piece);
  return world == worlds_.end() ? std::vector<io::MarkerCorners>() : world->second;
}

bool LiveMap::add(const map_t& part) {
  if (part.piece < 0 || part.piece >= part.piece_count) return false;
  Worlds worlds;
  for (const marker_t& marker : part.markers) {
    const std::optional<io::MarkerCorners> corners = markerCorners(marker);
    if (!corners) return false;
    worlds[marker.map_piece].push_back(*corners);
  }

  if (part.revision != revision_) parts_.clear();
  revision_ = part.revision;
  parts_[part.piece] = std::move(worlds);
  if (std::cmp_less(parts_.size(), part.piece_count)) return true;

  worlds_.clear();
  for (const auto& [number, some] : parts_) {
    for (const auto& [piece, markers] : some) {
      std::vector<io::MarkerCorners>& world = worlds_[piece];
      world.insert(world.end(), markers.begin(), markers.end());
    }
  }
  for (auto& [piece, markers] : worlds_) std::ranges::sort(markers, {}, &io::MarkerCorners::id);
  return true;
}

}  // namespace waymark::tools
