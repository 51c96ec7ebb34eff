#include "slam/picture_stage.h"

#include <algorithm>
#include <utility>

#include "slam/covariance/seen_through.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/pose_by_picture.h"

namespace waymark::slam {
namespace {

// One is looked at while the one before is answered.
constexpr std::size_t kAwaited = 4;

}  // namespace

Options withSurveyedPictures(Options options) {
  for (const PicturePrint& print : options.natural.prints) {
    if (!print.T_w_m) continue;
    options.markers.anchors.push_back(
        {pictureId(print.name), *print.T_w_m, print.sigma_m, print.sigma_rad});
  }
  return options;
}

PictureStage::PictureStage(const PictureStageParts& parts) : with_(parts) {
  if (!with_.map->empty() || !with_.options.mapping) placeSurveyed();
}

const PicturePrint* PictureStage::printOf(int id) const {
  const auto& prints = with_.options.natural.prints;
  const auto found =
      std::ranges::find(prints, id, [](const PicturePrint& p) { return pictureId(p.name); });
  return found == prints.end() ? nullptr : &*found;
}

void PictureStage::place(const PicturePrint& print, const Transform& T_w_m,
                         const Matrix6d& covariance) {
  const int id = with_.map->addPicture(print).id;
  with_.map->place(id, T_w_m, {}, covariance);
  with_.covariance->introduce(id, T_w_m, Matrix6d::Zero(), with_.map);
  ++with_.counters->mapped_pictures;
}

void PictureStage::placeSurveyed() {
  for (const PicturePrint& print : with_.options.natural.prints) {
    if (!print.T_w_m || with_.map->findPosed(pictureId(print.name)) != nullptr) continue;
    place(print, *print.T_w_m, independentCovariance(print.sigma_m, print.sigma_rad));
  }
}

bool PictureStage::hear(std::span<const LateResult> late, StageObserver* observer) {
  bool changed = false;
  for (const LateResult& seen : late) changed = hearOne(seen, observer) || changed;
  return changed;
}

// The relocalizer knew one lens, and no rows. What is not known of the rows is not counted here:
// the features are seen by the same ones, and would be believed instead.
std::optional<LateResult> PictureStage::asKnownByNow(const Awaited& awaited,
                                                     const LateResult& heard,
                                                     const PicturePrint& print) const {
  CameraUncertainty camera = with_.camera;
  camera.covariance.bottomRightCorner<1, 1>().setZero();
  const SeenThrough frame{.found_with = awaited.found_with,
                          .by_now = camera,
                          .readout_s = with_.shutter.seconds(),
                          .twist = awaited.frame.twist,
                          .monotonic_ns = awaited.frame.time.monotonic_ns};
  const auto by_now = [&](const PoseAtPlane& found) {
    return seenThrough(frame, found, print.width_m, print.height_m);
  };
  const auto pose = by_now({heard.T_m_c, heard.covariance});
  if (!pose) return std::nullopt;
  LateResult seen = heard;
  seen.T_m_c = pose->T_m_c;
  seen.covariance = pose->covariance;
  if (!heard.other) return seen;
  const auto other = by_now({heard.other->T_m_c, heard.other->covariance});
  if (!other) return std::nullopt;
  seen.other = {other->T_m_c, other->covariance};
  return seen;
}

bool PictureStage::hearOne(const LateResult& heard, StageObserver* observer) {
  const PicturePrint* const print = printOf(heard.landmark);
  const auto is_it = [&](const Awaited& a) { return a.frame.time.sequence == heard.sequence; };
  const auto awaited = std::ranges::find_if(awaited_, is_it);
  if (print == nullptr || awaited == awaited_.end()) {
    ++with_.counters->late_unknown;
    return false;
  }
  const auto by_now = asKnownByNow(*awaited, heard, *print);
  if (!by_now) {
    ++with_.counters->refused_pictures;
    return false;
  }
  const AwaitedFrame& frame = awaited->frame;
  const LateResult& seen = *by_now;
  // A pose that may be the other one of its plane is of use to who has one already.
  const bool begins =
      with_.map->empty() && with_.options.mapping && seen.decided && mayBegin(*print);
  if (begins) beginMap(frame, seen, *print);
  if (with_.options.mapping && seen.decided) with_.map->addPicture(*print);
  if (const MapMarker* const known = with_.map->findPosed(seen.landmark)) {
    with_.features->late(seen, *known, *print, observer);
  }
  const bool grows = with_.options.mapping && seen.decided && grow(frame, seen, *print, observer);
  return begins || grows;
}

bool PictureStage::grow(const AwaitedFrame& frame, const LateResult& seen,
                        const PicturePrint& print, StageObserver* observer) {
  const StageScope scope(observer, Stage::kMap);
  const bool was_placed = with_.map->findPosed(seen.landmark) != nullptr;
  if (!with_.updater->growByPicture(frame, seen, with_.map)) return false;
  const MapMarker* const known = with_.map->findPosed(seen.landmark);
  if (known == nullptr || was_placed) return true;
  // Its place has the frame's error in it already.
  with_.covariance->introduce(seen.landmark, *known->T_w_m, Matrix6d::Zero(), with_.map);
  if (print.T_w_m) placeSurveyed();  // the world is the survey's by now
  return true;
}

// The world is the survey's, where there is one: not a picture's that it does not know.
bool PictureStage::mayBegin(const PicturePrint& print) const {
  const auto& prints = with_.options.natural.prints;
  return print.T_w_m || std::ranges::none_of(prints, [](const PicturePrint& other) {
           return other.T_w_m.has_value();
         });
}

// Without any marker: the world is the survey's, else that frame's camera.
void PictureStage::beginMap(const AwaitedFrame& frame, const LateResult& seen,
                            const PicturePrint& print) {
  if (print.T_w_m) {
    placeSurveyed();
    return;
  }
  const Matrix6d covariance = covarianceOfInverse(seen.T_m_c, seen.covariance);
  const Transform T_c_m = seen.T_m_c.inverse();
  place(print, T_c_m, covariance);
  Keyframe first{.sequence = frame.time.sequence,
                 .monotonic_ns = frame.time.monotonic_ns,
                 .T_w_c = {},
                 .detections = {}};
  first.links = {{seen.landmark, T_c_m, covariance}};
  with_.map->addKeyframe(std::move(first));
  ++with_.counters->keyframes_added;
}

bool PictureStage::begin(const FrameInput& frame, StageObserver* observer) {
  if (!frame.found.empty()) return await(frame, {}, {}, observer);
  (void)with_.features->bridge(frame, {}, *with_.map, observer);
  return false;
}

std::optional<PoseEstimate> PictureStage::bridge(const FrameInput& frame,
                                                 std::span<const MarkerDetection> detections,
                                                 StageObserver* observer) {
  anchor_.reset();
  if (frame.found.empty()) return with_.features->bridge(frame, detections, *with_.map, observer);
  auto by_picture = poseByPicture(frame.found, frame.time.monotonic_ns, with_.camera, *with_.map);
  if (!by_picture) return std::nullopt;
  anchor_ = by_picture->picture;
  with_.covariance->doubtAs(*with_.map->findPosed(*anchor_));
  PoseEstimate& pose = by_picture->pose;
  pose.covariance += with_.covariance->sharedAt(pose.T_w_c.p);
  ++with_.counters->photographs_by_picture;
  return pose;
}

bool PictureStage::await(const FrameInput& frame, const FrameResult& result,
                         std::span<const MarkerDetection> fitting, StageObserver* observer) {
  if (!any() || (!frame.awaited && frame.found.empty())) return false;
  AwaitedFrame awaited{.time = frame.time, .T_w_c = {}, .detections = {}};
  const bool carried = result.pose && result.pose->source == PoseSource::kNaturalFeatures;
  if (result.pose && (carried || result.pose->source == PoseSource::kMarkers)) {
    awaited.T_w_c = result.pose->T_w_c;
    awaited.covariance = result.pose->view_covariance;
    awaited.twist = result.pose->twist;
    awaited.detections.assign(fitting.begin(), fitting.end());
    if (carried) awaited.anchor = anchor();
  }
  if (!frame.awaited) awaited_.clear();  // a photograph may come again
  if (awaited_.size() == kAwaited) awaited_.pop_front();
  awaited_.push_back({std::move(awaited), *with_.camera.camera});
  if (frame.awaited) with_.features->await(frame, result.pose.has_value(), observer);
  const bool changed = hear(frame.found, observer);
  if (changed) with_.covariance->noteChange();
  return changed;
}

void PictureStage::moveWorld(const Transform& T_new_old) {
  for (auto& [frame, found_with] : awaited_) {
    if (frame.T_w_c) frame.T_w_c = T_new_old * *frame.T_w_c;
    frame.covariance = turnedCovariance(T_new_old.R, frame.covariance);
  }
}

}  // namespace waymark::slam
