// What a bundle adjustment is about: cameras, markers, who sees what, and what is known beforehand.
#pragma once

#include <optional>
#include <vector>

#include "slam/detection/marker_detection.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"

namespace waymark::slam {

struct BundleProblem {
  struct Pose {
    Transform T;  // T_w_c or T_w_m
    bool fixed = false;
  };
  struct Observation {
    int camera = 0;  // index into cameras
    int marker = 0;  // index into markers
    const MarkerDetection* detection = nullptr;
  };
  // A surveyed marker pose: (dp, dtheta) from T to the estimate has this information matrix.
  struct Prior {
    int marker = 0;  // index into markers
    Transform T_w_m;
    Matrix6d information = Matrix6d::Identity();  // 1/m^2, 1/rad^2
  };
  // Intrinsics as unknowns (section 4.10), held by what the calibration says of them.
  struct Lens {
    CameraModel camera;
    IntrinsicVector expected = IntrinsicVector::Zero();
    IntrinsicVector sigma = IntrinsicVector::Zero();  // of expected; 0 keeps a parameter fixed
  };

  std::vector<Pose> cameras;
  std::vector<Pose> markers;
  std::vector<double> marker_sizes_m;  // as many as markers
  std::vector<Observation> observations;
  std::vector<Prior> priors;
  std::optional<Lens> lens;
};

}  // namespace waymark::slam
