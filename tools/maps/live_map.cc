#include "tools/maps/live_map.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>
#include <utility>

#include <Eigen/Geometry>

#include "slam/map/map.h"

namespace waymark::tools {
namespace {

// Anybody can send on a channel, so what comes is checked before it is used.
std::optional<slam::Transform> placeOf(const double (&p_w_m)[3], const double (&q_w_m)[4]) {
  const Eigen::Quaterniond q(q_w_m[0], q_w_m[1], q_w_m[2], q_w_m[3]);
  const Eigen::Vector3d p(p_w_m[0], p_w_m[1], p_w_m[2]);
  constexpr double kOffUnit = 1e-3;
  if (!p.allFinite() || !(std::abs(q.norm() - 1.0) < kOffUnit)) return std::nullopt;
  return slam::Transform::fromQuaternion(q, p);
}

bool isLength(double m) { return m > 0.0 && std::isfinite(m); }

std::optional<io::MarkerCorners> cornersOf(const marker_t& m) {
  const auto T_w_m = placeOf(m.p_w_m, m.q_w_m);
  if (m.id < 0 || !isLength(m.size) || !T_w_m) return std::nullopt;
  io::MarkerCorners marker{m.id, m.size, slam::markerCorners(m.size)};
  for (Eigen::Vector3d& corner : marker.corners) corner = *T_w_m * corner;
  return marker;
}

// One whose print the daemon was not told of comes without a height: a square, then.
std::optional<io::NaturalMarkerCorners> cornersOf(const natural_marker_t& m) {
  const double height_m = m.height == 0.0 ? m.width : m.height;
  const auto T_w_m = placeOf(m.p_w_m, m.q_w_m);
  if (!isLength(m.width) || !isLength(height_m) || !T_w_m) return std::nullopt;
  return io::NaturalMarkerCorners{m.name, io::rectangleCorners(*T_w_m, m.width, height_m)};
}

// By piece of the map; empty where anything is wrong.
template <typename Corners, typename Message>
std::optional<std::map<int, std::vector<Corners>>> worldsOf(const Message& part) {
  if (part.piece < 0 || part.piece >= part.piece_count) return std::nullopt;
  std::map<int, std::vector<Corners>> worlds;
  for (const auto& marker : part.markers) {
    const std::optional<Corners> corners = cornersOf(marker);
    if (!corners) return std::nullopt;
    worlds[marker.map_piece].push_back(*corners);
  }
  return worlds;
}

template <typename Corners>
std::vector<Corners> inPiece(const std::map<int, std::vector<Corners>>& worlds, int map_piece) {
  const auto world = worlds.find(map_piece);
  return world == worlds.end() ? std::vector<Corners>() : world->second;
}

}  // namespace

std::vector<io::MarkerCorners> LiveMap::markers(int map_piece) const {
  return inPiece(markers_.whole, map_piece);
}

std::vector<io::NaturalMarkerCorners> LiveMap::natural(int map_piece) const {
  return inPiece(natural_.whole, map_piece);
}

std::vector<int> LiveMap::worlds() const {
  std::set<int> pieces;
  for (const auto& [piece, markers] : markers_.whole) pieces.insert(piece);
  for (const auto& [piece, markers] : natural_.whole) pieces.insert(piece);
  return {pieces.begin(), pieces.end()};
}

template <typename Corners>
template <typename Message>
bool LiveMap::Worlds<Corners>::add(const Message& part, ByPiece corners) {
  if (part.revision != revision) parts.clear();
  revision = part.revision;
  parts[part.piece] = std::move(corners);
  if (std::cmp_less(parts.size(), part.piece_count)) return false;
  whole.clear();
  for (const auto& [number, some] : parts) {
    for (const auto& [piece, more] : some) {
      std::vector<Corners>& world = whole[piece];
      world.insert(world.end(), more.begin(), more.end());
    }
  }
  return true;
}

bool LiveMap::add(const map_t& part) {
  auto corners = worldsOf<io::MarkerCorners>(part);
  if (!corners) return false;
  if (!markers_.add(part, std::move(*corners))) return true;
  for (auto& [piece, markers] : markers_.whole) {
    std::ranges::sort(markers, {}, &io::MarkerCorners::id);
  }
  return true;
}

bool LiveMap::add(const natural_map_t& part) {
  auto corners = worldsOf<io::NaturalMarkerCorners>(part);
  if (!corners) return false;
  (void)natural_.add(part, std::move(*corners));
  return true;
}

}  // namespace waymark::tools
