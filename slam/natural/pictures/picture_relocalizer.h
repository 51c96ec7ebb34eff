// The relocaliser of seed 2, section 3.1: pictures in a frame, and where the camera was of each.
// Without threads: whoever calls it decides where it runs, and when its answer is given to the
// SLAM.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "base/image_view.h"
#include "slam/frame_time.h"
#include "slam/geometry/camera_model.h"
#include "slam/geometry/transform.h"
#include "slam/late_result.h"
#include "slam/natural/pictures/natural_marker.h"
#include "slam/natural/pictures/nearby_pictures.h"
#include "slam/natural/pictures/picture_finder.h"

namespace waymark::slam {

struct PictureRelocalizerOptions {
  // The image has decided between a plane's two poses when the other one explains it this much
  // worse, as of squares.
  double min_ambiguity_ratio = 3.0;
  NearbyPicturesOptions nearby;
  PictureFinderOptions finder;

  // Empty when usable, else what is wrong.
  [[nodiscard]] std::string invalidReason() const;
};

// Where the camera was last, if that is known.
struct LastPlace {
  Transform T_w_c;
  Eigen::Matrix3d position_covariance = Eigen::Matrix3d::Zero();  // metres squared, in the world
};

// A frame to look at.
struct RelocalizationQuery {
  FrameTime time;
  std::uint64_t generation = 0;   // of the SLAM that the answer is for
  ImageView image;                // of the camera's size
  std::optional<LastPlace> last;  // empty: lost, all pictures are looked for
};

// What has become of what was found, since the beginning.
struct RelocalizationCounts {
  std::uint64_t searches = 0;
  std::uint64_t located = 0;
  std::uint64_t not_verified = 0;  // features spoke for a place that the image does not confirm
  std::uint64_t ambiguous = 0;     // of these: the other pose explains the image nearly as well
  std::uint64_t alike = 0;         // which picture of several it is, is open
  std::uint64_t repeated = 0;      // seen more than once in one image: which print it is, is open
};

// Not to be shared between threads. Deterministic: equal queries in equal order have equal answers.
class PictureRelocalizer {
 public:
  // Takes the set. Precondition: options.invalidReason() is empty.
  explicit PictureRelocalizer(std::vector<PosedNaturalMarker> pictures,
                              const PictureRelocalizerOptions& options = {});
  PictureRelocalizer(const PictureRelocalizer&) = delete;
  PictureRelocalizer& operator=(const PictureRelocalizer&) = delete;

  // The pictures in the frame that can be told from all others: `landmark` is the picture's id,
  // T_m_c the camera in the picture's frame, covariance of its delta (Transform::retract); with the
  // other pose, where the image leaves one open. Valid until the next call. camera: the lens in
  // use.
  [[nodiscard]] std::span<const LateResult> locate(const RelocalizationQuery& query,
                                                   const CameraModel& camera);

  // Where a picture hangs, found by the map since; empty: not known any more. Precondition:
  // `picture` is in the set.
  void setPose(int picture, const std::optional<Transform>& T_w_m);

  [[nodiscard]] std::size_t size() const { return markers_.size(); }
  [[nodiscard]] const std::vector<int>& ids() const { return ids_; }  // in the order of the set
  [[nodiscard]] const std::vector<std::optional<Transform>>& poses() const { return T_w_m_; }
  [[nodiscard]] const RelocalizationCounts& counts() const { return counts_; }

 private:
  [[nodiscard]] std::span<const int> candidatesFor(const std::optional<LastPlace>& last);
  [[nodiscard]] bool isOneOfAKind(const FoundPicture& found);
  [[nodiscard]] LateResult resultOf(const RelocalizationQuery& query, const FoundPicture& found);

  PictureRelocalizerOptions options_;
  std::vector<NaturalMarker> markers_;
  std::vector<int> ids_;
  std::vector<std::optional<Transform>> T_w_m_;
  PictureFinder finder_;  // of markers_
  // Looked among last time: kept while it has all that is near, as an index of others costs more
  // than a few pictures too many.
  std::vector<int> candidates_;
  std::vector<LateResult> results_;
  RelocalizationCounts counts_;
};

// The camera in the picture's frame and its covariance, from the picture in the camera's.
[[nodiscard]] LateResult cameraInPicture(const Transform& T_c_m, const Matrix6d& covariance);

}  // namespace waymark::slam
