#include "io/frame_poses.h"

#include "base/decimal_seconds.h"
#include "io/text/number_text.h"

namespace waymark::io {
namespace {

constexpr int kMetreDecimals = 9;
constexpr int kTurnDecimals = 12;
constexpr int kTriangleFields = 21;
// From piece to rms_px.
constexpr int kPoseFields = 1 + 7 + kTriangleFields + 3;

const char* nameOf(FrameStatus status) {
  switch (status) {
    case FrameStatus::kInitializing:
      return "initializing";
    case FrameStatus::kTracking:
      return "tracking";
    case FrameStatus::kBridging:
      return "bridging";
    case FrameStatus::kRelocalizing:
      return "relocalizing";
    case FrameStatus::kLost:
      return "lost";
  }
  return "";
}

const char* nameOf(slam::PoseSource source) {
  switch (source) {
    case slam::PoseSource::kNone:
      return "";
    case slam::PoseSource::kMarkers:
      return "markers";
    case slam::PoseSource::kNaturalFeatures:
      return "natural_features";
    case slam::PoseSource::kPrediction:
      return "prediction";
  }
  return "";
}

std::string poseColumns() {
  std::string text = "t,frame,status,source,piece,px,py,pz,qw,qx,qy,qz";
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) {
      text += ",c" + std::to_string(row) + std::to_string(column);
    }
  }
  return text + ",markers,features,rms_px,reason,ambiguity\n";
}

// RFC 4180: in quotes where it has a comma or quotes.
std::string csvField(const std::string& text) {
  if (text.find_first_of(",\"\n") == text.npos) return text;
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"') result += '"';
    result += c;
  }
  return result + '"';
}

std::string framePoseText(const slam::PoseEstimate& pose) {
  std::string text = std::to_string(pose.piece);
  const Eigen::Vector3d& p = pose.T_w_c.p;
  for (const double v : {p.x(), p.y(), p.z()}) text += ',' + fixed(v, kMetreDecimals);
  const Eigen::Quaterniond q = pose.T_w_c.quaternion();
  for (const double v : {q.w(), q.x(), q.y(), q.z()}) text += ',' + fixed(v, kTurnDecimals);
  for (Eigen::Index row = 0; row < 6; ++row) {
    for (Eigen::Index column = row; column < 6; ++column) {
      text += ',' + roundTrip(pose.covariance(row, column));
    }
  }
  return text + ',' + std::to_string(pose.markers_used) + ',' + std::to_string(pose.features_used) +
         ',' + roundTrip(pose.reprojection_rms_px);
}

}  // namespace

std::string formatFramePoses(std::span<const FramePose> frames) {
  std::string text = poseColumns();
  for (const FramePose& frame : frames) {
    text += formatSeconds(frame.time_ns) + ',' + std::to_string(frame.frame) + ',' +
            nameOf(frame.status) + ',';
    if (frame.pose) {
      text += std::string(nameOf(frame.pose->source)) + ',' + framePoseText(*frame.pose) + ",," +
              roundTrip(frame.pose->ambiguity_ratio);
    } else {
      text += std::string(static_cast<std::size_t>(kPoseFields), ',') + ',' +
              csvField(frame.reason) + ',';
    }
    text += '\n';
  }
  return text;
}

std::map<int, Trajectory> trajectoriesOf(std::span<const FramePose> frames) {
  std::map<int, Trajectory> trajectories;
  for (const FramePose& frame : frames) {
    if (frame.pose) trajectories[frame.pose->piece].push_back({frame.time_ns, frame.pose->T_w_c});
  }
  return trajectories;
}

}  // namespace waymark::io
