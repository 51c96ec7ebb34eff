#include "daemon/publish/messages.h"

#include <set>
#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "daemon/publish/natural_messages.h"
#include "io/text/json_node.h"

namespace waymark::daemon {
namespace {

slam::Transform someTransform() {
  slam::Vector6d delta;
  delta << 1.0, -2.0, 3.0, 0.3, -0.4, 0.5;
  return slam::Transform{}.retract(delta);
}

FrameRecord localizedRecord() {
  FrameRecord record;
  record.stamp = {.sequence = 12, .monotonic_ns = 5'000, .utime = 77};
  record.state = slam::TrackingState::kTracking;
  slam::PoseEstimate pose;
  pose.T_w_c = someTransform();
  for (int i = 0; i < 6; ++i) {
    for (int j = 0; j < 6; ++j) {
      pose.covariance(i, j) = 10.0 * i + j;
      pose.view_covariance(i, j) = 100.0 + 10.0 * i + j;
    }
  }
  pose.source = slam::PoseSource::kMarkers;
  pose.markers_used = 4;
  pose.reprojection_rms_px = 0.2;
  pose.ambiguity_ratio = 9.0;
  record.pose = pose;
  record.map_piece = 6;
  return record;
}

TEST(PoseMessage, CarriesTheEstimate) {
  pose_t message{};
  fillPose(localizedRecord(), 5'000, message);
  const slam::Transform T = someTransform();
  EXPECT_EQ(message.utime, 77);
  EXPECT_EQ(message.monotonic_ns, 5'000);
  EXPECT_EQ(message.sequence, 12);
  EXPECT_EQ(message.status, pose_t::STATUS_TRACKING);
  EXPECT_EQ(message.reason, "");
  EXPECT_EQ(message.source, pose_t::SOURCE_MARKERS);
  EXPECT_TRUE(message.had_pose);
  EXPECT_EQ(message.last_pose_age_ns, 0);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(message.p_w_c[i], T.p[i]);
  const Eigen::Quaterniond q(message.q_w_c[0], message.q_w_c[1], message.q_w_c[2],
                             message.q_w_c[3]);
  EXPECT_LT((q.toRotationMatrix() - T.R).norm(), 1e-12);
  EXPECT_EQ(message.covariance[1], 1.0) << "row 0, column 1: row-major";
  EXPECT_EQ(message.covariance[6], 10.0) << "row 1, column 0";
  EXPECT_EQ(message.view_covariance[1], 101.0);
  EXPECT_EQ(message.view_covariance[35], 155.0);
  EXPECT_EQ(message.markers_used, 4);
  EXPECT_EQ(message.reprojection_rms_px, 0.2);
  EXPECT_EQ(message.ambiguity_ratio, 9.0);
  EXPECT_EQ(message.map_piece, 6);
}

TEST(JointMessage, SaysWhereTheCoordinatesWent) {
  slam::PieceEvent event{slam::PieceEvent::Kind::kParted, 3, 1, someTransform(), {}};
  event.covariance = slam::Matrix6d::Identity();
  event.covariance(0, 1) = 0.5;
  joint_t message{};
  fillJoint(event, {.sequence = 12, .monotonic_ns = 5'000, .utime = 77}, message);
  EXPECT_EQ(message.utime, 77);
  EXPECT_EQ(message.monotonic_ns, 5'000);
  EXPECT_EQ(message.sequence, 12);
  EXPECT_EQ(message.kind, joint_t::KIND_PARTED);
  EXPECT_EQ(message.map_piece, 3);
  EXPECT_EQ(message.into, 1);
  for (int i = 0; i < 3; ++i) EXPECT_EQ(message.p_into_piece[i], someTransform().p[i]);
  EXPECT_EQ(message.covariance[1], 0.5);
  event.kind = slam::PieceEvent::Kind::kJoined;
  fillJoint(event, {}, message);
  EXPECT_EQ(message.kind, joint_t::KIND_JOINED);
}

TEST(PoseMessage, WithoutPoseSaysWhyAndHowOldAndKeepsNothingOfTheLast) {
  pose_t message{};
  fillPose(localizedRecord(), 5'000, message);
  FrameRecord record = localizedRecord();
  record.pose.reset();
  record.state = slam::TrackingState::kRelocalizing;
  record.reason = slam::NoPoseReason::kNoMarker;
  record.stamp.monotonic_ns = 8'000;
  fillPose(record, 5'000, message);
  EXPECT_EQ(message.status, pose_t::STATUS_RELOCALIZING);
  EXPECT_EQ(message.reason, "no marker in view");
  EXPECT_EQ(message.source, pose_t::SOURCE_NONE);
  EXPECT_TRUE(message.had_pose);
  EXPECT_EQ(message.last_pose_age_ns, 3'000);
  for (const double x : message.p_w_c) EXPECT_EQ(x, 0.0);
  for (const double x : message.q_w_c) EXPECT_EQ(x, 0.0);
  for (const double x : message.covariance) EXPECT_EQ(x, 0.0);
  for (const double x : message.view_covariance) EXPECT_EQ(x, 0.0);
  EXPECT_EQ(message.markers_used, 0);

  fillPose(record, {}, message);
  EXPECT_FALSE(message.had_pose);
  EXPECT_EQ(message.last_pose_age_ns, 0);

  record.state = slam::TrackingState::kLost;
  record.reason = slam::NoPoseReason::kCarriedTooUncertain;
  fillPose(record, 5'000, message);
  EXPECT_EQ(message.status, pose_t::STATUS_RELOCALIZING) << "it has no status of its own for that";
  EXPECT_EQ(message.reason, "the carried pose is less certain than its limit");
}

TEST(PoseMessage, NoCameraNamesTheCauseAndKeepsTheSequence) {
  pose_t message{};
  fillPose(localizedRecord(), 5'000, message);
  fillNoCamera("/dev/video0: unplugged", 99, 9'000, 5'000, message);
  EXPECT_EQ(message.status, pose_t::STATUS_NO_CAMERA);
  EXPECT_EQ(message.reason, "/dev/video0: unplugged");
  EXPECT_EQ(message.source, pose_t::SOURCE_NONE);
  EXPECT_EQ(message.sequence, 12);
  EXPECT_EQ(message.utime, 99);
  EXPECT_EQ(message.last_pose_age_ns, 4'000);
}

TEST(DetectionsMessage, CarriesEveryMarkerUpToTheLimitAndFits) {
  FrameRecord record = localizedRecord();
  record.seen = FrameRecord::kMaxSeen + 5;
  for (int i = 0; i < FrameRecord::kMaxSeen; ++i) {
    SeenMarker& marker = record.markers[static_cast<std::size_t>(i)];
    marker.id = i;
    marker.hamming = i % 3;
    for (int k = 0; k < 4; ++k) {
      marker.pixels[static_cast<std::size_t>(k)] = Eigen::Vector2d(i + 0.25 * k, -i);
    }
  }
  detections_t message{};
  fillDetections(record, "4X4_50", message);
  EXPECT_EQ(message.sequence, 12);
  EXPECT_EQ(message.dictionary, "4X4_50");
  EXPECT_EQ(message.seen, record.seen);
  ASSERT_EQ(message.count, FrameRecord::kMaxSeen);
  EXPECT_EQ(message.detections[7].id, 7);
  EXPECT_EQ(message.detections[7].hamming, 1);
  EXPECT_EQ(message.detections[7].corners_px[3][0], 7.75);
  EXPECT_EQ(message.detections[7].corners_px[3][1], -7.0);
  EXPECT_LT(message.getEncodedSize(), 60'000);
}

TEST(MapMessage, LargeMapsComeInPiecesThatFitAndHoldEveryMarkerOnce) {
  for (const int markers : {0, 1, 150, 151, 2345}) {
    MapSnapshot map;
    map.stamp.utime = 5;
    map.keyframe_count = 3;
    slam::Matrix6d covariance = slam::Matrix6d::Zero();
    covariance(1, 2) = 0.25;
    covariance(1, 1) = 0.04;
    for (int i = 0; i < markers; ++i) {
      map.markers.push_back({i, 0.1, someTransform(), covariance, i % 2 == 1, 7});
    }

    std::set<int> ids;
    map_t message{};
    const int pieces = mapPieceCount(map);
    ASSERT_GE(pieces, 1) << "an empty map is news too";
    for (int piece = 0; piece < pieces; ++piece) {
      fillMapPiece(map, "ARUCO_ORIGINAL", 8, piece, message);
      EXPECT_LT(message.getEncodedSize(), 60'000);
      EXPECT_EQ(message.revision, 8);
      EXPECT_EQ(message.piece, piece);
      EXPECT_EQ(message.piece_count, pieces);
      EXPECT_EQ(message.marker_count, markers);
      EXPECT_EQ(message.keyframe_count, 3);
      for (const marker_t& marker : message.markers) {
        EXPECT_TRUE(ids.insert(marker.id).second) << marker.id << " came twice";
        EXPECT_EQ(marker.p_w_m[2], someTransform().p.z());
        EXPECT_EQ(marker.covariance[8], 0.25) << "row 1, column 2";
        EXPECT_EQ(marker.state,
                  marker.id % 2 == 1 ? marker_t::STATE_UNDECIDED : marker_t::STATE_MAPPED);
        EXPECT_EQ(marker.views, 7);
      }
    }
    EXPECT_EQ(static_cast<int>(ids.size()), markers);
  }
}

TEST(MapMessage, MarkersWithoutAPoseAreToldOf) {
  using slam::MarkerState;
  for (const int markers : {3, 1000}) {
    MapSnapshot map;
    map.markers.push_back({5000, 0.1, someTransform()});
    const MarkerState states[] = {MarkerState::kUnresolved, MarkerState::kQuarantined,
                                  MarkerState::kBanned, MarkerState::kElsewhere};
    for (int i = 0; i < markers; ++i) map.unposed.push_back({i, 0.2, states[i % 4], i});
    std::set<int> ids;
    map_t message{};
    for (int piece = 0; piece < mapPieceCount(map); ++piece) {
      fillMapPiece(map, "ARUCO_ORIGINAL", 8, piece, message);
      EXPECT_LT(message.getEncodedSize(), 60'000);
      EXPECT_EQ(message.marker_count, 1);
      EXPECT_EQ(message.count, piece == 0 ? 1 : 0);
      for (const unposed_marker_t& marker : message.unposed) {
        EXPECT_TRUE(ids.insert(marker.id).second) << marker.id << " came twice";
        EXPECT_EQ(marker.size, 0.2);
        EXPECT_EQ(marker.views, marker.id);
        EXPECT_EQ(marker.state, marker.id % 4);
      }
    }
    EXPECT_EQ(std::ssize(ids), markers);
  }
}

TEST(MapMessage, SigmaIsThatOfTheWorstAxis) {
  MapSnapshot map;
  map.markers.push_back({1, 0.1, someTransform()});
  map.markers.back().covariance.diagonal() << 1e-4, 4e-4, 1e-6, 9.0, 9.0, 9.0;
  map_t message{};
  fillMapPiece(map, "ARUCO_ORIGINAL", 1, 0, message);
  EXPECT_NEAR(message.markers.front().sigma_m, 0.02, 1e-12);
}

slam::PicturePrint print(const std::string& name) {
  slam::PicturePrint print;
  print.name = name;
  print.width_m = 0.6;
  print.height_m = 0.8;
  return print;
}

PrintsById twoPrints() { return byId({print("poster"), print("exit sign")}); }

TEST(NaturalDetectionsMessage, CarriesWhatTookEffectWithTheFrame) {
  FrameRecord record = localizedRecord();
  record.searched = true;
  record.heard = 1;
  slam::LateResult& late = record.late[0];
  late.sequence = 5;
  late.landmark = slam::pictureId("exit sign");
  late.T_m_c = io::asRead(someTransform());
  late.covariance(1, 2) = 0.25;
  natural_detections_t message{};
  fillNaturalDetections(record, twoPrints(), message);
  EXPECT_EQ(message.sequence, 12);
  EXPECT_EQ(message.searched, 1);
  ASSERT_EQ(message.count, 1);
  const natural_detection_t& detection = message.detections[0];
  EXPECT_EQ(detection.sequence, 5);
  EXPECT_EQ(detection.name, "exit sign");
  EXPECT_EQ(detection.p_m_c[1], someTransform().p.y());
  EXPECT_EQ(detection.covariance[8], 0.25) << "row 1, column 2";
  const Eigen::Quaterniond q(detection.q_m_c[0], detection.q_m_c[1], detection.q_m_c[2],
                             detection.q_m_c[3]);
  EXPECT_EQ(slam::Transform::fromQuaternion(q, Eigen::Vector3d::Zero()).R, late.T_m_c.R)
      << "to the last bit";
  EXPECT_EQ(detection.decided, 1);
  EXPECT_EQ(detection.has_other, 0);
  late.decided = false;
  late.ambiguity_ratio = 1.25;
  late.other = slam::LateResult::OtherPose{late.T_m_c, late.covariance};
  fillNaturalDetections(record, twoPrints(), message);
  EXPECT_EQ(message.detections[0].decided, 0);
  EXPECT_EQ(message.detections[0].ambiguity_ratio, 1.25);
  EXPECT_EQ(message.detections[0].has_other, 1);
  EXPECT_EQ(message.detections[0].other_p_m_c[1], someTransform().p.y());
  EXPECT_EQ(message.detections[0].other_covariance[8], 0.25);
  record.heard = 0;
  fillNaturalDetections(record, twoPrints(), message);
  EXPECT_EQ(message.count, 0);
  EXPECT_TRUE(message.detections.empty());
}

TEST(NaturalDetectionsMessage, AFullFrameFitsInAMessage) {
  FrameRecord record = localizedRecord();
  record.heard = record.late.size();
  for (slam::LateResult& late : record.late) late.landmark = slam::pictureId("poster");
  natural_detections_t message{};
  fillNaturalDetections(record, {{slam::pictureId("poster"), print(std::string(500, 'x'))}},
                        message);
  EXPECT_LT(message.getEncodedSize(), 60'000);
}

TEST(NaturalMapMessage, LargeMapsComeInPieces) {
  for (const int pictures : {0, 1, 120, 121, 1000}) {
    MapSnapshot map;
    PrintsById prints;
    for (int i = 0; i < pictures; ++i) {
      prints[i] = print(std::string(95, 'x') + std::to_string(i));
      map.pictures.push_back({i, 0.6, someTransform(), slam::Matrix6d::Identity()});
    }
    std::set<std::string> names;
    natural_map_t message{};
    for (int piece = 0; piece < naturalPieceCount(map); ++piece) {
      fillNaturalMapPiece(map, prints, 8, piece, message);
      EXPECT_LT(message.getEncodedSize(), 60'000);
      EXPECT_EQ(message.revision, 8);
      EXPECT_EQ(message.marker_count, pictures);
      EXPECT_EQ(message.piece_count, naturalPieceCount(map));
      for (const natural_marker_t& marker : message.markers) {
        names.insert(marker.name);
        EXPECT_EQ(marker.width, 0.6);
        EXPECT_EQ(marker.height, 0.8);
        EXPECT_EQ(marker.p_w_m[2], someTransform().p.z());
        EXPECT_EQ(marker.covariance[7], 1.0);
      }
    }
    EXPECT_EQ(static_cast<int>(names.size()), pictures);
  }
}

// A body that turns and moves evenly in its own frame.
TEST(BotCorePose, CarriesTheBodysState) {
  BodyState state;
  state.T_w_b.p = {1.0, 2.0, 3.0};
  state.T_w_b.R = slam::expSo3(Eigen::Vector3d(0.1, 0.2, 0.3));
  state.velocity_b = {0.4, 0.5, 0.6};
  state.rotation_rate_b = {0.7, 0.8, 0.9};
  bot_core::pose_t message{};
  fillBotCorePose(state, 77, message);
  EXPECT_EQ(message.utime, 77);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(message.pos[i], state.T_w_b.p[i]);
    EXPECT_EQ(message.vel[i], state.velocity_b[i]);
    EXPECT_EQ(message.rotation_rate[i], state.rotation_rate_b[i]);
    EXPECT_EQ(message.accel[i], 0.0);
  }
  EXPECT_EQ(message.orientation[0], state.T_w_b.quaternion().w());
  EXPECT_EQ(message.orientation[3], state.T_w_b.quaternion().z());
}

}  // namespace
}  // namespace waymark::daemon
