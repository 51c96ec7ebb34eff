#include "tools/maps/map_align.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Geometry>
#include <Eigen/SVD>

#include "io/text/number_text.h"

namespace waymark::tools {
namespace {

using Eigen::Vector3d;

// A marker that is turned so far from the others of its kind was named by mistake.
constexpr double kMistaken_rad = 0.5;
// Two markers nearer to each other than this, as seen from above, say no direction, metres.
constexpr double kNoDirection_m = 1e-3;

Error noPlace(int id) { return Error{"marker " + std::to_string(id) + " has no place in the map"}; }

// One that is named by itself must be there; of a range those that are.
Result<std::vector<slam::Transform>> posesOf(const std::string& what, const slam::Map& map,
                                             const std::vector<slam::IdRange>& ids,
                                             std::vector<int>* found) {
  std::vector<slam::Transform> poses;
  for (const slam::IdRange& range : ids) {
    if (range.first == range.last && map.findPosed(range.first) == nullptr) {
      return noPlace(range.first);
    }
    const auto end = map.markers().upper_bound(range.last);
    for (auto it = map.markers().lower_bound(range.first); it != end; ++it) {
      if (!it->second.T_w_m) continue;
      poses.push_back(*it->second.T_w_m);
      found->push_back(it->first);
    }
  }
  if (poses.empty()) return Error{what + ": none of these markers has a place in the map"};
  return poses;
}

// The mean of the poses' axes, which must be much alike.
Result<Vector3d> commonAxis(const std::vector<slam::Transform>& poses, const std::vector<int>& ids,
                            Eigen::Index axis, const std::string& otherwise) {
  Vector3d sum = Vector3d::Zero();
  for (const slam::Transform& T_w_m : poses) sum += T_w_m.R.col(axis);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double angle = std::acos(
        std::clamp(poses[i].R.col(axis).dot(sum) / std::max(sum.norm(), 1e-12), -1.0, 1.0));
    if (angle > kMistaken_rad) {
      return Error{"marker " + std::to_string(ids[i]) + otherwise + " (" +
                   io::fixed(angle * 180.0 / std::numbers::pi, 0) + " degrees)"};
    }
  }
  return Vector3d(sum.normalized());
}

Vector3d centreOf(const std::vector<slam::Transform>& poses) {
  Vector3d centre = Vector3d::Zero();
  for (const slam::Transform& T_w_m : poses) centre += T_w_m.p / static_cast<double>(poses.size());
  return centre;
}

// Of the plane that is nearest to the centres, where these are far enough from a line to have one;
// else what the faces say.
Vector3d floorNormal(const std::vector<slam::Transform>& poses, const Vector3d& by_faces) {
  constexpr double kAcross_m = 0.3;  // root mean square; less, and the faces know better
  if (poses.size() < 3) return by_faces;
  const Vector3d centre = centreOf(poses);
  Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
  for (const slam::Transform& T_w_m : poses) {
    spread +=
        (T_w_m.p - centre) * (T_w_m.p - centre).transpose() / static_cast<double>(poses.size());
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(spread, Eigen::ComputeFullU);
  if (std::sqrt(svd.singularValues()[1]) < kAcross_m) return by_faces;
  const Vector3d normal = svd.matrixU().col(2);
  return normal.dot(by_faces) < 0.0 ? Vector3d(-normal) : normal;
}

double rms(double squares, std::size_t count) {
  return std::sqrt(squares / static_cast<double>(count));
}

struct Floor {
  std::vector<slam::Transform> poses;
  Vector3d normal = Vector3d::UnitZ();
};

Result<Floor> findFloor(const slam::Map& map, const AlignOptions& options) {
  std::vector<int> ids;
  const auto poses = posesOf("--floor", map, options.floor, &ids);
  if (!poses) return poses.error();
  const auto faces =
      commonAxis(*poses, ids, 2, " does not face where the other markers of the floor do");
  if (!faces) return faces.error();
  return Floor{*poses, floorNormal(*poses, *faces)};
}

void putFloorAtZero(const Floor& floor, AlignReport* report) {
  if (floor.poses.empty()) return;
  slam::Transform& T_new_old = report->T_new_old;
  T_new_old.p.z() = -(T_new_old.R * centreOf(floor.poses)).z();
  double squares = 0.0;
  for (const slam::Transform& T_w_m : floor.poses) {
    const double height_m = (T_new_old * T_w_m.p).z();
    squares += height_m * height_m;
  }
  report->floor_markers = floor.poses.size();
  report->floor_rms_m = rms(squares, floor.poses.size());
}

struct Upright {
  std::size_t markers = 0;
  Vector3d up = Vector3d::UnitZ();
  double rms_rad = 0.0;
};

Result<Upright> findUpright(const slam::Map& map, const AlignOptions& options) {
  std::vector<int> ids;
  const auto poses = posesOf("--up", map, options.up, &ids);
  if (!poses) return poses.error();
  const auto up = commonAxis(*poses, ids, 1, " does not hang upright as the others do");
  if (!up) return up.error();
  double squares = 0.0;
  for (const slam::Transform& T_w_m : *poses) squares += T_w_m.R.col(1).cross(*up).squaredNorm();
  return Upright{poses->size(), *up, rms(squares, poses->size())};
}

// The rotation that has z as its third row, and x, or what of it is not along z, as its first.
Eigen::Matrix3d axes(const Vector3d& z, const Vector3d& x_wanted) {
  const Vector3d x = (x_wanted - x_wanted.dot(z) * z).normalized();
  Eigen::Matrix3d R_new_old;
  R_new_old << x.transpose(), z.cross(x).transpose(), z.transpose();
  return R_new_old;
}

Result<Eigen::Matrix3d> heading(const slam::Map& map, const AlignOptions& options,
                                const Vector3d& z, bool z_is_known) {
  if (!options.xy) {
    return Eigen::Quaterniond::FromTwoVectors(z, Vector3d::UnitZ()).normalized().toRotationMatrix();
  }
  const slam::MapMarker* const to = map.findPosed(*options.xy);
  if (to == nullptr) return noPlace(*options.xy);
  const Vector3d along = to->T_w_m->p - map.findPosed(*options.origin)->T_w_m->p;
  const double across_m = (along - along.dot(z) * z).norm();
  if (across_m < kNoDirection_m) {
    return Error{"marker " + std::to_string(*options.xy) + " is right above or below marker " +
                 std::to_string(*options.origin) + ", which says no direction"};
  }
  if (z_is_known) return axes(z, along);
  const Vector3d x = along.normalized();
  return axes((z - z.dot(x) * x).normalized(), x);
}

}  // namespace

std::string AlignOptions::invalidReason() const {
  if (floor.empty() && up.empty() && !origin) {
    return "nothing to align by: give --floor, --up or --origin";
  }
  if (xy && !origin) return "--xy needs --origin";
  if (xy && xy == origin) return "--xy and --origin are the same marker";
  return {};
}

std::vector<slam::IdRange> AlignOptions::named() const {
  std::vector<slam::IdRange> ids = floor;
  ids.insert(ids.end(), up.begin(), up.end());
  for (const auto& id : {origin, xy}) {
    if (id) ids.push_back({*id, *id});
  }
  return ids;
}

Result<AlignReport> alignMap(slam::Map* map, const AlignOptions& options) {
  if (const std::string reason = options.invalidReason(); !reason.empty()) return Error{reason};
  AlignReport report;
  Vector3d z = Vector3d::UnitZ();
  Floor floor;
  if (!options.floor.empty()) {
    const Result<Floor> found = findFloor(*map, options);
    if (!found) return found.error();
    floor = *found;
    z = floor.normal;
  }
  if (!options.up.empty()) {
    const Result<Upright> upright = findUpright(*map, options);
    if (!upright) return upright.error();
    z = upright->up;
    report.upright_markers = upright->markers;
    report.upright_rms_rad = upright->rms_rad;
  }
  const slam::MapMarker* const origin = options.origin ? map->findPosed(*options.origin) : nullptr;
  if (options.origin && origin == nullptr) return noPlace(*options.origin);
  const bool z_is_known = !options.floor.empty() || !options.up.empty();
  const auto R_new_old = heading(*map, options, z, z_is_known);
  if (!R_new_old) return R_new_old.error();
  report.T_new_old.R = *R_new_old;
  if (origin != nullptr) report.T_new_old.p = -(*R_new_old * origin->T_w_m->p);
  putFloorAtZero(floor, &report);
  map->moveWorld(report.T_new_old);
  return report;
}

std::string alignText(const AlignReport& report) {
  std::string text;
  const auto markers = [](std::size_t count) {
    return std::to_string(count) + (count == 1 ? " marker" : " markers");
  };
  if (report.floor_markers > 0) {
    text += "floor: " + markers(report.floor_markers) + ", " +
            io::fixed(1000.0 * report.floor_rms_m, 1) + " mm rms from z = 0\n";
  }
  if (report.upright_markers > 0) {
    text += "up: " + markers(report.upright_markers) + ", " +
            io::fixed(report.upright_rms_rad * 180.0 / std::numbers::pi, 2) +
            " degrees rms from the vertical\n";
  }
  const double turn = std::acos(std::clamp(0.5 * (report.T_new_old.R.trace() - 1.0), -1.0, 1.0));
  text += "moved by " + io::fixed(report.T_new_old.p.norm(), 3) + " m, turned by " +
          io::fixed(turn * 180.0 / std::numbers::pi, 2) + " degrees\n";
  return text;
}

}  // namespace waymark::tools
