#include "slam/slam.h"

#include <algorithm>
#include <cstdint>
#include <utility>

#include "slam/batch_mapper.h"
#include "slam/camera/corner_coverage.h"
#include "slam/camera/lens_start.h"
#include "slam/camera/undistort_map.h"
#include "slam/frame_detector.h"
#include "slam/picture_stage.h"
#include "slam/piece.h"
#include "slam/piece_set.h"

namespace waymark::slam {

// The detection, and the pieces of the map.
class Slam::Impl {
 public:
  Impl(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map,
       std::vector<Map> other_pieces)
      : options_(withSurveyedPictures(options)),
        camera_(camera),
        lens_(LensKnowledge::of(camera, /*exact=*/!options.lens.learn)),
        lens_start_(startOf(options_, camera)),
        coverage_(camera.width(), camera.height()),
        detector_(camera_, std::move(dictionary), options_.detector, options_.follower, &counters_),
        pieces_(std::in_place, options_, detector_.dictionary().name(), &camera_, &lens_,
                &counters_, std::move(map), std::move(other_pieces)) {}

  FrameResult process(const FrameInput& frame, StageObserver* observer) {
    ++counters_.frames;
    const Piece& here = std::as_const(*pieces_).active();
    const auto detections = detector_.detect(frame, here.map(), here.local(),
                                             here.predict(frame.time.monotonic_ns), observer);
    undistorted_with_ = frame.detections ? 0 : lens_.changes;
    counters_.image_cells_seen += static_cast<std::uint64_t>(coverage_.add(detections));
    if (lens_start_ && !beginWithLens(detections)) {
      return {.state = TrackingState::kInitializing,
              .pose = {},
              .reason = detections.empty() ? NoPoseReason::kNoMarker : NoPoseReason::kLensUnknown,
              .piece_events = {},
              .detections = detections};
    }
    FrameResult result = pieces_->process(frame, throughLensInUse(detections), observer);
    result.found = frame.found;
    if (result.pose) ++counters_.localized;
    return result;
  }

  void beginAnew() {
    pieces_.emplace(options_, detector_.dictionary().name(), &camera_, &lens_, &counters_, Map(),
                    std::vector<Map>());
  }

  [[nodiscard]] PieceSet& pieces() { return *pieces_; }
  [[nodiscard]] const PieceSet& pieces() const { return *pieces_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }
  [[nodiscard]] const LensKnowledge& lens() const { return lens_; }

 private:
  // Nothing to find out where the calibration is given.
  static std::optional<LensStart> startOf(const Options& options, const CameraModel& camera) {
    if (options.lens.given || !options.lens.learn) return std::nullopt;
    return LensStart(camera, options.lens.prior, options.markers, options.lens.start);
  }

  // False while the squares so far do not tell enough of the lens. Then the pieces begin anew: much
  // in them is as the focal length has it.
  bool beginWithLens(std::span<const MarkerDetection> detections) {
    const auto found = lens_start_->process(detections);
    if (!found) return false;
    lens_start_.reset();
    camera_ = found->camera;
    lens_.adopt(found->camera, found->covariance, 0.0, 0.0, options_.lens.prior, 0.0);
    std::vector<Map> maps;
    for (const Map* map : pieces().maps()) maps.push_back(*map);
    Map first = std::move(maps.front());
    maps.erase(maps.begin());
    pieces_.emplace(options_, detector_.dictionary().name(), &camera_, &lens_, &counters_,
                    std::move(first), std::move(maps));
    return true;
  }

  // Corners that came with the frame were undistorted by the lens as it was given; those found in
  // it by the one that was in use then.
  std::span<const MarkerDetection> throughLensInUse(std::span<const MarkerDetection> detections) {
    if (undistorted_with_ == lens_.changes) return detections;
    undistorted_.assign(detections.begin(), detections.end());
    undistortAgain(camera_, &undistorted_);
    return undistorted_;
  }

  Options options_;
  CameraModel camera_;  // in use
  LensKnowledge lens_;
  std::optional<LensStart> lens_start_;  // until a camera that was not given is known a little
  CornerCoverage coverage_;
  Counters counters_;
  FrameDetector detector_;
  std::optional<PieceSet> pieces_;  // always there
  int undistorted_with_ = 0;        // the changes of the lens that the frame's corners know
  std::vector<MarkerDetection> undistorted_;  // reused from frame to frame
};

Slam::Slam(const CameraModel& camera, Dictionary dictionary, const Options& options, Map map,
           std::vector<Map> other_pieces)
    : impl_(std::make_unique<Impl>(camera, std::move(dictionary), options, std::move(map),
                                   std::move(other_pieces))) {}
Slam::~Slam() = default;

FrameResult Slam::process(const FrameInput& frame, StageObserver* observer) {
  return impl_->process(frame, observer);
}

const Map& Slam::map() const { return std::as_const(*impl_).pieces().active().map(); }
std::vector<const Map*> Slam::pieces() const { return std::as_const(*impl_).pieces().maps(); }
PoseEstimate Slam::asOfNow(PoseEstimate pose) const {
  return impl_->pieces().asOfNow(std::move(pose));
}
const Counters& Slam::counters() const { return impl_->counters(); }
const CameraModel& Slam::camera() const { return impl_->camera(); }
const LensKnowledge& Slam::lens() const { return impl_->lens(); }
void Slam::densify(std::span<const RecordedFrame> frames) { impl_->pieces().densify(frames); }
bool Slam::joinPieces() { return impl_->pieces().joinAll(); }

void Slam::beginAnew() { impl_->beginAnew(); }

void Slam::finish() {
  impl_->pieces().finishJoint();
  impl_->pieces().forEach([](Piece& piece) { piece.batch().recoverCovariance(); });
}

void Slam::optimizeGlobally() {
  impl_->pieces().finishJoint();
  impl_->pieces().forEach([](Piece& piece) { piece.batch().optimize(); });
}

void Slam::estimateLens() { impl_->pieces().estimateLens(); }

void Slam::optimizeGloballyWithIntrinsics() { impl_->pieces().optimizeWithIntrinsics(); }

std::optional<PoseEstimate> Slam::localize(const RecordedFrame& frame) const {
  const Piece* const piece = std::as_const(*impl_).pieces().find(frame.piece);
  return piece != nullptr ? piece->batch().localize(frame) : std::nullopt;
}

std::optional<PosesOfOneMarker> Slam::localizeByOneMarker(const RecordedFrame& frame) const {
  const Piece* const piece = std::as_const(*impl_).pieces().find(frame.piece);
  return piece != nullptr ? piece->batch().localizeByOneMarker(frame) : std::nullopt;
}

double Slam::readout_s() const {
  return std::as_const(*impl_).pieces().active().readout().readout_s;
}

}  // namespace waymark::slam
