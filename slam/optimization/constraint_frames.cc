#include "slam/optimization/constraint_frames.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <optional>

#include <Eigen/Cholesky>

#include "base/sorted.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/optimization/block_kernels.h"
#include "slam/optimization/marker_relation.h"

namespace waymark::slam {
namespace {

using Relation = BundleProblem::Relation;
using Kind = ConstraintSource::Kind;
using Eigen::Vector3d;

// Axes of which z is the given one; of no length: as they are.
Eigen::Matrix3d axesAlong(const Vector3d& z) {
  if (!(z.norm() > 1e-9)) return Eigen::Matrix3d::Identity();
  return Eigen::Quaterniond::FromTwoVectors(Vector3d::UnitZ(), z).normalized().toRotationMatrix();
}

// x where the z axis was, y where x was.
Eigen::Matrix3d cyclicAxes() {
  Eigen::Matrix3d R;
  R << 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0;
  return R;
}

double squared(double x) { return x * x; }

// dp, then dtheta, along the frame's axes.
Vector6d gaugeOf(const Vector3d& points, const Vector3d& turns) {
  Vector6d gauge;
  gauge << points, turns;
  return gauge;
}

class FrameBuilder {
 public:
  FrameBuilder(const MarkerConstraints& constraints, std::span<const ConstrainedMarker> markers)
      : constraints_(constraints), markers_(markers) {}

  void addPositions() {
    ConstraintFrame world;
    world.fixed = true;
    for (std::size_t i = 0; i < constraints_.positions.size(); ++i) {
      const SurveyedPosition& position = constraints_.positions[i];
      const auto marker = find(position.id);
      if (!marker) continue;
      const Vector3d weight = Vector3d::Constant(1.0 / position.sigma_m);
      world.members.push_back(
          {*marker,
           {point(Vector3d::Zero(), position.p_w, weight, {Kind::kPosition, i, position.id})}});
    }
    take(std::move(world));
  }

  void addPlane(std::size_t index) {
    const MarkerPlane& plane = constraints_.planes[index];
    ConstraintFrame frame;
    Vector3d normal = Vector3d::Zero();
    const std::vector<std::size_t> members = inRanges(plane.ids);
    for (const std::size_t marker : members) {
      const Transform& T_w_m = markers_[marker].T_w_m;
      frame.T_w_f.p += T_w_m.p / static_cast<double>(members.size());
      normal += T_w_m.R.col(2);
      const int id = markers_[marker].id;
      frame.members.push_back(
          {marker,
           {point(Vector3d::Zero(), Vector3d::Zero(), Vector3d::UnitZ() / plane.sigma_m,
                  {Kind::kPlane, index, id}),
            direction(Vector3d::UnitZ(), Vector3d::UnitZ(),
                      Vector3d::Constant(1.0 / plane.sigma_rad), {Kind::kPlaneTilt, index, id})}});
    }
    frame.T_w_f.R = axesAlong(normal);
    frame.gauge = gaugeOf(Vector3d(1.0, 1.0, 0.0) / squared(plane.sigma_m),
                          Vector3d::UnitZ() / squared(plane.sigma_rad));
    take(std::move(frame));
  }

  // What is upright, and what is level or upright as part of a plane. Where only walls are known,
  // nobody knows the vertical.
  void addVertical() {
    std::map<std::size_t, std::vector<Relation>> relations;  // by marker
    Vector3d up = Vector3d::Zero();
    for (const std::size_t marker : inRanges(constraints_.upright.ids)) {
      up += markers_[marker].T_w_m.R.col(1);
      relations[marker].push_back(
          direction(Vector3d::UnitY(), Vector3d::UnitZ(),
                    Vector3d::Constant(1.0 / constraints_.upright.sigma_rad),
                    {Kind::kUpright, 0, markers_[marker].id}));
    }
    for (std::size_t i = 0; i < constraints_.planes.size(); ++i) {
      addAttitude(i, &up, &relations);
    }
    ConstraintFrame frame;
    frame.fixed = constraints_.up_w.has_value();
    if (frame.fixed) up = *constraints_.up_w;
    if (!(up.norm() > 0.0)) return;
    frame.T_w_f.R = axesAlong(up.normalized());
    frame.gauge =
        gaugeOf(Vector3d::Ones(), Vector3d::UnitZ() / squared(constraints_.upright.sigma_rad));
    for (auto& [marker, of_marker] : relations) {
      frame.members.push_back({marker, std::move(of_marker)});
    }
    take(std::move(frame));
  }

  void addDistance(std::size_t index) {
    const CornerDistance& distance = constraints_.distances[index];
    const auto a = find(distance.id_a);
    const auto b = find(distance.id_b);
    if (!a || !b) return;
    built_.distances.push_back(
        {*a, *b, corner(*a, distance.corner_a), corner(*b, distance.corner_b), distance.distance_m,
         distance.sigma_m, addSource({Kind::kDistance, index, distance.id_a})});
  }

  [[nodiscard]] ConstraintFrames finish() { return std::move(built_); }

 private:
  [[nodiscard]] std::optional<std::size_t> find(int id) const {
    const auto found = std::ranges::lower_bound(markers_, id, {}, &ConstrainedMarker::id);
    if (found == markers_.end() || found->id != id) return std::nullopt;
    return static_cast<std::size_t>(found - markers_.begin());
  }

  [[nodiscard]] std::vector<std::size_t> inRanges(const std::vector<IdRange>& ids) const {
    std::vector<std::size_t> found;
    for (const IdRange& range : ids) {
      auto it = std::ranges::lower_bound(markers_, range.first, {}, &ConstrainedMarker::id);
      for (; it != markers_.end() && it->id <= range.last; ++it) {
        found.push_back(static_cast<std::size_t>(it - markers_.begin()));
      }
    }
    return found;
  }

  [[nodiscard]] Vector3d corner(std::size_t marker, int k) const {
    return markerCorners(markers_[marker].size_m)[static_cast<std::size_t>(k)];
  }

  Relation point(const Vector3d& in_marker, const Vector3d& in_frame, const Vector3d& weight,
                 const ConstraintSource& source) {
    return {in_marker, true, in_frame, weight, addSource(source)};
  }
  Relation direction(const Vector3d& in_marker, const Vector3d& in_frame, const Vector3d& weight,
                     const ConstraintSource& source) {
    return {in_marker, false, in_frame, weight, addSource(source)};
  }
  int addSource(const ConstraintSource& source) {
    built_.sources.push_back(source);
    return static_cast<int>(built_.sources.size()) - 1;
  }

  // A plane of a known kind is as level, or as upright, as one marker of its sigma would be: its
  // markers, which follow it anyway, share that.
  void addAttitude(std::size_t index, Vector3d* up,
                   std::map<std::size_t, std::vector<Relation>>* relations) {
    const MarkerPlane& plane = constraints_.planes[index];
    if (plane.kind == PlaneKind::kAny) return;
    const std::vector<std::size_t> members = inRanges(plane.ids);
    const double weight =
        1.0 / (plane.sigma_rad *
               std::sqrt(static_cast<double>(std::max<std::size_t>(members.size(), 1))));
    const double sign = plane.kind == PlaneKind::kCeiling ? -1.0 : 1.0;
    for (const std::size_t marker : members) {
      const ConstraintSource source{Kind::kLevel, index, markers_[marker].id};
      if (plane.kind == PlaneKind::kWall) {
        (*relations)[marker].push_back(
            direction(Vector3d::UnitZ(), Vector3d::Zero(), weight * Vector3d::UnitZ(), source));
        continue;
      }
      *up += sign * markers_[marker].T_w_m.R.col(2);
      (*relations)[marker].push_back(direction(Vector3d::UnitZ(), sign * Vector3d::UnitZ(),
                                               Vector3d::Constant(weight), source));
    }
  }

  void take(ConstraintFrame frame) {
    if (frame.members.size() < (frame.fixed ? 1U : 2U)) return;
    if (!frame.fixed) fit(&frame);
    built_.frames.push_back(std::move(frame));
  }

  // The markers as they are: iterated least squares with a kernel, which one of them that is
  // elsewhere pulls no farther than a few sigmas would.
  void fit(ConstraintFrame* frame) const {
    constexpr double kHuber = 2.0;
    constexpr int kIterations = 10;
    constexpr double kConverged = 1e-7;
    for (int i = 0; i < kIterations; ++i) {
      Matrix6d H = turnedCovariance(frame->T_w_f.R, frame->gauge.asDiagonal());
      Vector6d g = Vector6d::Zero();
      for (const ConstraintFrame::Member& member : frame->members) {
        const Transform& T_w_m = markers_[member.marker].T_w_m;
        const RelationSums sums = sumRelations(member.relations, frame->T_w_f, T_w_m, kHuber);
        const Vector3d d = T_w_m.p - frame->T_w_f.p;
        const Matrix6d KtH = transposedTransport<6>(d, sums.H);
        H += transposedTransport<6>(d, KtH.transpose());
        g -= transposedTransport<1>(d, sums.g);
      }
      const Eigen::LLT<Matrix6d> factor(H);
      if (factor.info() != Eigen::Success) return;
      const Vector6d step = -factor.solve(g);
      if (!step.allFinite()) return;
      frame->T_w_f = frame->T_w_f.retract(step);
      if (step.norm() < kConverged) return;
    }
  }

  const MarkerConstraints& constraints_;
  std::span<const ConstrainedMarker> markers_;
  ConstraintFrames built_;
};

void addRanges(const Map& map, const std::vector<IdRange>& ids, std::vector<int>* found) {
  for (const IdRange& range : ids) {
    const auto end = map.markers().upper_bound(range.last);
    for (auto it = map.markers().lower_bound(range.first); it != end; ++it) {
      found->push_back(it->first);
    }
  }
}

}  // namespace

std::vector<ConstrainedMarker> constrainedMarkers(const Map& map, const MarkerOptions& options) {
  const MarkerConstraints& constraints = options.constraints;
  std::vector<int> ids;
  for (const SurveyedPosition& position : constraints.positions) ids.push_back(position.id);
  for (const MarkerPlane& plane : constraints.planes) addRanges(map, plane.ids, &ids);
  addRanges(map, constraints.upright.ids, &ids);
  for (const CornerDistance& distance : constraints.distances) {
    ids.push_back(distance.id_a);
    ids.push_back(distance.id_b);
  }
  sortUnique(&ids);
  std::vector<ConstrainedMarker> markers;
  for (const int id : ids) {
    const MapMarker* const marker = map.findPosed(id);
    if (marker != nullptr) markers.push_back({id, *marker->T_w_m, marker->size_m});
  }
  return markers;
}

ConstraintFrames constraintFrames(const MarkerConstraints& constraints,
                                  std::span<const ConstrainedMarker> markers, bool in_survey) {
  FrameBuilder builder(constraints, markers);
  if (in_survey) builder.addPositions();
  for (std::size_t i = 0; i < constraints.planes.size(); ++i) builder.addPlane(i);
  builder.addVertical();
  for (std::size_t i = 0; i < constraints.distances.size(); ++i) builder.addDistance(i);
  return builder.finish();
}

// As much too short, or too long, at one end as at the other.
ConstraintFrame rulerOf(const MeasuredDistance& distance,
                        std::span<const ConstrainedMarker> markers) {
  constexpr double kRoll_rad = 0.01;  // about the ruler, of which nothing is known
  const Vector3d weight = Vector3d(std::numbers::sqrt2, 1.0, 1.0) / distance.sigma_m;
  const auto end = [&](std::size_t marker, const Vector3d& in_marker, const Vector3d& in_frame) {
    return ConstraintFrame::Member{marker, {{in_marker, true, in_frame, weight, distance.source}}};
  };
  const Vector3d p_a = markers[distance.a].T_w_m * distance.in_a;
  const Vector3d along = markers[distance.b].T_w_m * distance.in_b - p_a;
  ConstraintFrame ruler;
  ruler.T_w_f.R = axesAlong(along) * cyclicAxes();
  ruler.T_w_f.p = p_a + 0.5 * (along.norm() - distance.distance_m) * ruler.T_w_f.R.col(0);
  ruler.gauge = gaugeOf(Vector3d::Zero(), Vector3d::UnitX() / squared(kRoll_rad));
  ruler.members = {end(distance.a, distance.in_a, Vector3d::Zero()),
                   end(distance.b, distance.in_b, distance.distance_m * Vector3d::UnitX())};
  return ruler;
}

}  // namespace waymark::slam
