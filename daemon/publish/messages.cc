#include "daemon/publish/messages.h"

#include <algorithm>
#include <span>

#include "daemon/publish/message_fields.h"

namespace waymark::daemon {
namespace {

// 140 markers of 373 bytes and as many without a pose, of 17: 54 kB, below the 60 kB above which
// messages get lost in the field.
constexpr std::size_t kMarkersPerPiece = 140;

std::int8_t unposedState(slam::MarkerState state) {
  switch (state) {
    case slam::MarkerState::kQuarantined:
      return unposed_marker_t::STATE_QUARANTINED;
    case slam::MarkerState::kBanned:
      return unposed_marker_t::STATE_REFUSED;
    case slam::MarkerState::kElsewhere:
      return unposed_marker_t::STATE_ELSEWHERE;
    case slam::MarkerState::kUnresolved:
    case slam::MarkerState::kMapped:
      return unposed_marker_t::STATE_UNRESOLVED;
  }
  return unposed_marker_t::STATE_UNRESOLVED;
}

// What of a list belongs to a piece.
template <typename T>
std::span<const T> ofPiece(const std::vector<T>& all, std::size_t piece) {
  const std::size_t begin = std::min(piece * kMarkersPerPiece, all.size());
  return std::span(all).subspan(begin, std::min(kMarkersPerPiece, all.size() - begin));
}

std::int8_t status(slam::TrackingState state) {
  switch (state) {
    case slam::TrackingState::kInitializing:
      return pose_t::STATUS_INITIALIZING;
    case slam::TrackingState::kTracking:
      return pose_t::STATUS_TRACKING;
    case slam::TrackingState::kBridging:
      return pose_t::STATUS_BRIDGING;
    case slam::TrackingState::kRelocalizing:
    case slam::TrackingState::kLost:  // the message has no word of its own for it: `reason` tells
      return pose_t::STATUS_RELOCALIZING;
  }
  return pose_t::STATUS_INITIALIZING;
}

std::int8_t source(slam::PoseSource source) {
  switch (source) {
    case slam::PoseSource::kNone:
      return pose_t::SOURCE_NONE;
    case slam::PoseSource::kMarkers:
      return pose_t::SOURCE_MARKERS;
    case slam::PoseSource::kNaturalFeatures:
      return pose_t::SOURCE_NATURAL_FEATURES;
    case slam::PoseSource::kPrediction:
      return pose_t::SOURCE_PREDICTION;
  }
  return pose_t::SOURCE_NONE;
}

void fillAge(std::int64_t now_ns, std::optional<std::int64_t> last_pose_ns, pose_t& message) {
  message.had_pose = last_pose_ns ? 1 : 0;
  message.last_pose_age_ns = last_pose_ns ? now_ns - *last_pose_ns : 0;
}

void fillEstimate(const slam::PoseEstimate& pose, pose_t& message) {
  message.source = source(pose.source);
  put(pose.T_w_c.p, message.p_w_c);
  put(pose.T_w_c.quaternion(), message.q_w_c);
  put(pose.covariance, message.covariance);
  put(pose.view_covariance, message.view_covariance);
  message.markers_used = pose.markers_used;
  message.reprojection_rms_px = pose.reprojection_rms_px;
  message.ambiguity_ratio = pose.ambiguity_ratio;
}

void clearEstimate(pose_t& message) {
  message.source = pose_t::SOURCE_NONE;
  std::ranges::fill(message.p_w_c, 0.0);
  std::ranges::fill(message.q_w_c, 0.0);
  std::ranges::fill(message.covariance, 0.0);
  std::ranges::fill(message.view_covariance, 0.0);
  message.markers_used = 0;
  message.reprojection_rms_px = 0.0;
  message.ambiguity_ratio = 0.0;
}

std::int8_t lensState(slam::LensState state) {
  switch (state) {
    case slam::LensState::kGiven:
      return lens_t::STATE_GIVEN;
    case slam::LensState::kLearning:
      return lens_t::STATE_LEARNING;
    case slam::LensState::kLearned:
      return lens_t::STATE_LEARNED;
  }
  return lens_t::STATE_GIVEN;
}

}  // namespace

void fillPose(const FrameRecord& record, std::optional<std::int64_t> last_pose_ns,
              pose_t& message) {
  message.utime = record.stamp.utime;
  message.monotonic_ns = record.stamp.monotonic_ns;
  message.sequence = static_cast<std::int64_t>(record.stamp.sequence);
  message.status = status(record.state);
  message.reason = slam::describe(record.reason);
  message.map_piece = record.map_piece;
  fillAge(record.stamp.monotonic_ns, last_pose_ns, message);
  if (record.pose) {
    fillEstimate(*record.pose, message);
  } else {
    clearEstimate(message);
  }
}

void fillNoCamera(const std::string& reason, std::int64_t utime, std::int64_t monotonic_ns,
                  std::optional<std::int64_t> last_pose_ns, pose_t& message) {
  message.utime = utime;
  message.monotonic_ns = monotonic_ns;
  message.status = pose_t::STATUS_NO_CAMERA;
  message.reason = reason;
  fillAge(monotonic_ns, last_pose_ns, message);
  clearEstimate(message);
  message.latency_ns = 0;
}

void fillDetections(const FrameRecord& record, const std::string& dictionary,
                    detections_t& message) {
  message.utime = record.stamp.utime;
  message.monotonic_ns = record.stamp.monotonic_ns;
  message.sequence = static_cast<std::int64_t>(record.stamp.sequence);
  message.dictionary = dictionary;
  message.seen = record.seen;
  message.count = std::min(record.seen, FrameRecord::kMaxSeen);
  message.detections.resize(static_cast<std::size_t>(message.count));
  for (std::size_t i = 0; i < message.detections.size(); ++i) {
    const SeenMarker& marker = record.markers[i];
    detection_t& detection = message.detections[i];
    detection.id = marker.id;
    detection.hamming = marker.hamming;
    for (std::size_t k = 0; k < 4; ++k) {
      detection.corners_px[k][0] = marker.pixels[k].x();
      detection.corners_px[k][1] = marker.pixels[k].y();
    }
  }
}

void fillJoint(const slam::PieceEvent& event, const capture::FrameStamp& stamp, joint_t& message) {
  message.utime = stamp.utime;
  message.monotonic_ns = stamp.monotonic_ns;
  message.sequence = static_cast<std::int64_t>(stamp.sequence);
  message.kind =
      event.kind == slam::PieceEvent::Kind::kJoined ? joint_t::KIND_JOINED : joint_t::KIND_PARTED;
  message.map_piece = event.piece;
  message.into = event.into;
  put(event.T_into_piece.p, message.p_into_piece);
  put(event.T_into_piece.quaternion(), message.q_into_piece);
  put(event.covariance, message.covariance);
}

int mapPieceCount(const MapSnapshot& map) {
  const std::size_t most = std::max(map.markers.size(), map.unposed.size());
  return static_cast<int>(
      std::max<std::size_t>(1, (most + kMarkersPerPiece - 1) / kMarkersPerPiece));
}

void fillMapPiece(const MapSnapshot& map, const std::string& dictionary, std::int64_t revision,
                  int piece, map_t& message) {
  message.utime = map.stamp.utime;
  message.monotonic_ns = map.stamp.monotonic_ns;
  message.revision = revision;
  message.piece = piece;
  message.piece_count = mapPieceCount(map);
  message.dictionary = dictionary;
  message.marker_count = static_cast<std::int32_t>(map.markers.size());
  message.keyframe_count = map.keyframe_count;
  const auto markers = ofPiece(map.markers, static_cast<std::size_t>(piece));
  message.count = static_cast<std::int32_t>(markers.size());
  message.markers.resize(markers.size());
  for (std::size_t i = 0; i < markers.size(); ++i) {
    const MapSnapshot::Marker& marker = markers[i];
    marker_t& out = message.markers[i];
    out.id = marker.id;
    out.size = marker.size_m;
    put(marker.T_w_m.p, out.p_w_m);
    put(marker.T_w_m.quaternion(), out.q_w_m);
    put(marker.covariance, out.covariance);
    out.map_piece = marker.map_piece;
    out.state = marker.undecided ? marker_t::STATE_UNDECIDED : marker_t::STATE_MAPPED;
    out.views = marker.views;
    out.sigma_m = positionSigma(marker.covariance.topLeftCorner<3, 3>());
    out.map_piece = marker.map_piece;
  }
  const auto unposed = ofPiece(map.unposed, static_cast<std::size_t>(piece));
  message.unposed_count = static_cast<std::int32_t>(unposed.size());
  message.unposed.resize(unposed.size());
  for (std::size_t i = 0; i < unposed.size(); ++i) {
    message.unposed[i].id = unposed[i].id;
    message.unposed[i].size = unposed[i].size_m;
    message.unposed[i].state = unposedState(unposed[i].state);
    message.unposed[i].views = unposed[i].views;
  }
}

void fillLens(const LensRecord& record, lens_t& message) {
  const slam::Calibration& c = record.calibration;
  const bool fisheye = c.model == slam::DistortionModel::kEquidistant;
  message.state = lensState(record.state);
  message.model = fisheye ? lens_t::MODEL_EQUIDISTANT : lens_t::MODEL_RATIONAL;
  message.width = c.width;
  message.height = c.height;
  message.fx = c.fx;
  message.fy = c.fy;
  message.cx = c.cx;
  message.cy = c.cy;
  std::ranges::copy(c.distortion, message.distortion);
  message.focal_sigma = record.focal_sigma;
  message.rms_before_px = record.rms_before_px;
  message.rms_after_px = record.rms_after_px;
  message.changes = record.changes;
}

void fillBotCorePose(const BodyState& state, std::int64_t utime, bot_core::pose_t& message) {
  message.utime = utime;
  put(state.T_w_b.p, message.pos);
  put(state.velocity_b, message.vel);
  put(state.T_w_b.quaternion(), message.orientation);
  put(state.rotation_rate_b, message.rotation_rate);
  std::ranges::fill(message.accel, 0.0);
}

}  // namespace waymark::daemon
