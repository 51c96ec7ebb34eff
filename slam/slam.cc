#include "slam/slam.h"

#include <algorithm>
#include <utility>

#include "slam/batch_mapper.h"
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
        detector_(camera_, std::move(dictionary), options_.detector, options_.follower, &counters_),
        pieces_(options_, detector_.dictionary().name(), &camera_, &counters_, std::move(map),
                std::move(other_pieces)) {}

  FrameResult process(const FrameInput& frame, StageObserver* observer) {
    ++counters_.frames;
    const Piece& here = std::as_const(pieces_).active();
    const auto detections = detector_.detect(frame, here.map(), here.local(),
                                             here.predict(frame.time.monotonic_ns), observer);
    const FrameResult result = pieces_.process(frame, detections, observer);
    if (result.pose) ++counters_.localized;
    return result;
  }

  [[nodiscard]] PieceSet& pieces() { return pieces_; }
  [[nodiscard]] const PieceSet& pieces() const { return pieces_; }
  [[nodiscard]] const Counters& counters() const { return counters_; }
  [[nodiscard]] const CameraModel& camera() const { return camera_; }

 private:
  Options options_;
  CameraModel camera_;
  Counters counters_;
  FrameDetector detector_;
  PieceSet pieces_;
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
PoseEstimate Slam::asOfNow(PoseEstimate pose) const { return impl_->pieces().asOfNow(pose); }
const Counters& Slam::counters() const { return impl_->counters(); }
const CameraModel& Slam::camera() const { return impl_->camera(); }
void Slam::densify(std::span<const RecordedFrame> frames) { impl_->pieces().densify(frames); }
bool Slam::joinPieces() { return impl_->pieces().joinAll(); }

void Slam::finish() {
  impl_->pieces().forEach([](Piece& piece) { piece.batch().recoverCovariance(); });
}

void Slam::optimizeGlobally() {
  impl_->pieces().forEach([](Piece& piece) { piece.batch().optimize(); });
}

void Slam::optimizeGloballyWithIntrinsics() { impl_->pieces().optimizeWithIntrinsics(); }

std::optional<PoseEstimate> Slam::localize(const RecordedFrame& frame) const {
  const Piece* const piece = std::as_const(*impl_).pieces().find(frame.piece);
  return piece != nullptr ? piece->batch().localize(frame) : std::nullopt;
}

std::optional<PosesOfOneMarker> Slam::localizeByOneMarker(const RecordedFrame& frame) const {
  const Piece* const piece = std::as_const(*impl_).pieces().find(frame.piece);
  return piece != nullptr ? piece->batch().localizeByOneMarker(frame) : std::nullopt;
}

double Slam::readout_s() const { return std::as_const(*impl_).pieces().active().readout_s(); }

}  // namespace waymark::slam
