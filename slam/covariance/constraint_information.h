// What is known of the markers besides their views (MarkerConstraints), in the system of their
// marginals: their frames are poses of it, too. What the map contradicts is left out, as in its
// optimizations.
#pragma once

#include <span>
#include <vector>

#include "slam/map/map.h"
#include "slam/map/marker_options.h"
#include "slam/optimization/block_system.h"
#include "slam/optimization/constraint_frames.h"

namespace waymark::slam {

// How far something that is known of a marker is from what all else says.
struct ConstraintResidual {
  ConstraintSource source;
  // Of the residual that it would have were it not there, in its standard deviations, of both
  // sides. Zero where nothing else says; but of what the map leaves out at least as far as it is
  // from there in its own standard deviations.
  double sigmas = 0.0;
};

// The system is about the differences from these poses.
struct ConstrainedUnknown {
  int pose = -1;  // of the system; -1 for a marker that is no unknown
  Transform T_w_m;
};

class ConstraintInformation {
 public:
  // Of a map as it is; pointOf(id, T_w_m): the point about which the system is linear. Anchors are
  // tested only: whoever makes the system counts them.
  template <typename PointOf>
  ConstraintInformation(const Map& map, const MarkerOptions& options, const PointOf& pointOf) {
    for (std::size_t i = 0; i < options.anchors.size(); ++i) {
      const Anchor& anchor = options.anchors[i];
      const MapMarker* const marker = map.findPosed(anchor.id);
      if (marker != nullptr) addAnchor(i, anchor, pointOf(anchor.id, *marker->T_w_m));
    }
    if (options.constraints.empty()) return;
    std::vector<ConstrainedMarker> markers = constrainedMarkers(map, options);
    for (ConstrainedMarker& marker : markers) {
      const ConstrainedUnknown unknown = pointOf(marker.id, marker.T_w_m);
      marker.T_w_m = unknown.T_w_m;
      poses_.push_back(unknown.pose);
    }
    begin(map, options, markers);
  }

  // Adds a pose for each frame, by its neighbours; and to the markers', those they have by a
  // distance.
  void appendPoses(std::vector<std::vector<int>>* neighbours);
  // variance: of the residuals, in whose units the system is.
  void addTo(double variance, BlockSystem* system) const;
  // After solve(): what the residuals are in the best map.
  void solved(BlockSystem* system);
  // After solved() and invert().
  [[nodiscard]] std::vector<ConstraintResidual> residuals(double variance,
                                                          BlockSystem* system) const;

 private:
  using Jacobian = Eigen::Matrix<double, 3, 6>;
  // A residual between a marker and a frame, or another marker.
  struct Tie {
    int marker = -1;  // pose of the system; -1 for a fixed one
    int other = -1;   // likewise; of a frame, its number until it has a pose
    bool to_frame = true;
    int source = 0;
    bool left_out = false;
    bool counted = false;  // in the system already
    // In sigmas: at the point, then in the best map.
    Eigen::Vector3d residual = Eigen::Vector3d::Zero();
    double pull = 1.0;  // Huber's weight
    Jacobian J_marker = Jacobian::Zero();
    Jacobian J_other = Jacobian::Zero();
  };
  struct Frame {
    int pose = -1;
    Matrix6d gauge = Matrix6d::Zero();
    std::vector<int> members;  // poses of markers
  };
  void addAnchor(std::size_t index, const Anchor& anchor, const ConstrainedUnknown& marker);
  void begin(const Map& map, const MarkerOptions& options,
             std::span<const ConstrainedMarker> markers);
  void addFrame(const ConstraintFrame& frame, std::span<const ConstrainedMarker> markers);
  void addDistance(const MeasuredDistance& distance, std::span<const ConstrainedMarker> markers);
  void leaveOut(double gate_sigmas);
  // Of a tie's residual, from the marginals of both poses.
  [[nodiscard]] static Eigen::Matrix3d covarianceOf(const Tie& tie, double variance,
                                                    BlockSystem* system);

  std::vector<int> poses_;  // of the constrained markers
  std::vector<ConstraintSource> sources_;
  int first_source_ = 0;  // of those that are no anchors
  // By source: how far it is from the map in its own sigmas, where that leaves it out; else 0.
  std::vector<double> left_out_by_;
  std::vector<Frame> frames_;
  std::vector<Tie> ties_;
};

}  // namespace waymark::slam
