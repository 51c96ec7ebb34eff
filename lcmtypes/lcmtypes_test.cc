// Wire hashes of the types other people's programs know, and a round trip of every field.
#include <cstdint>
#include <vector>

#include <bot_core/image_t.hpp>
#include <bot_core/pose_t.hpp>
#include <gtest/gtest.h>

#include <waymark/calibration_t.hpp>
#include <waymark/detections_t.hpp>
#include <waymark/health_t.hpp>
#include <waymark/joint_t.hpp>
#include <waymark/map_t.hpp>
#include <waymark/pose_t.hpp>
#include <waymark/preview_t.hpp>

namespace waymark {
namespace {

// Encodes, decodes, and checks that every byte was used both ways.
template <typename Message>
Message throughTheWire(const Message& sent) {
  std::vector<std::uint8_t> bytes(static_cast<std::size_t>(sent.getEncodedSize()));
  const int size = static_cast<int>(bytes.size());
  EXPECT_EQ(sent.encode(bytes.data(), 0, size), size);
  Message received;
  EXPECT_EQ(received.decode(bytes.data(), 0, size), size);
  EXPECT_LT(received.decode(bytes.data(), 0, size - 1), 0) << "a cut message must be refused";
  return received;
}

// Fills an array with values that differ from each other and from other arrays'.
template <typename T, std::size_t N>
void fill(T (&values)[N], double first) {
  for (std::size_t i = 0; i < N; ++i) values[i] = first + 0.1 * static_cast<double>(i);
}

template <typename T, std::size_t N>
void expectSame(const T (&a)[N], const T (&b)[N]) {
  for (std::size_t i = 0; i < N; ++i) EXPECT_EQ(a[i], b[i]) << "element " << i;
}

TEST(LcmTypes, BotCoreHashesAreTheOnesSubscribersKnow) {
  EXPECT_EQ(static_cast<std::uint64_t>(bot_core::pose_t::getHash()), 0x2e16efb052b0105eULL);
  EXPECT_EQ(static_cast<std::uint64_t>(bot_core::image_t::getHash()), 0x14739ffe13d5f5f0ULL);
}

// Subscribers built against another definition get nothing: a change is for CHANGELOG.md.
TEST(LcmTypes, OurOwnHashesChangeOnPurposeOnly) {
  EXPECT_EQ(static_cast<std::uint64_t>(pose_t::getHash()), 0xa3e50267be6a9996ULL);
  EXPECT_EQ(static_cast<std::uint64_t>(map_t::getHash()), 0x2d849061eccebf26ULL);
  EXPECT_EQ(static_cast<std::uint64_t>(preview_t::getHash()), 0xb54277ce33c4b8f5ULL);
  EXPECT_EQ(static_cast<std::uint64_t>(calibration_t::getHash()), 0xaf3be2a42a4c6ed8ULL);
}

TEST(LcmTypes, BotCorePixelFormatsSpellTheirCodes) {
  const auto code = [](const char(&s)[5]) { return s[0] | s[1] << 8 | s[2] << 16 | s[3] << 24; };
  EXPECT_EQ(bot_core::image_t::PIXEL_FORMAT_GRAY, code("GREY"));
  EXPECT_EQ(bot_core::image_t::PIXEL_FORMAT_MJPEG, code("MJPG"));
}

TEST(LcmTypes, PreviewRoundTrip) {
  preview_t a{};
  a.utime = 1'700'000'000'000'001;
  a.monotonic_ns = 42;
  a.sequence = 7;
  a.width = 1280;
  a.height = 720;
  a.rejected_count = 2;
  a.rejected_px = {{{1, 2}, {3, 4}, {5, 6}, {7, 8}}, {{-1, -2}, {3.5, 4}, {5, 6}, {7, 8.25}}};
  a.size = 3;
  a.jpeg = {0xff, 0xd8, 0x00};
  const preview_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.monotonic_ns, b.monotonic_ns);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  EXPECT_EQ(a.rejected_px, b.rejected_px);
  EXPECT_EQ(a.jpeg, b.jpeg);
}

TEST(LcmTypes, CalibrationRoundTrip) {
  calibration_t a{};
  a.utime = 1'700'000'000'000'001;
  a.monotonic_ns = 42;
  a.sequence = 7;
  a.width = 640;
  a.height = 480;
  a.advice = "Hold it still";
  a.enough = 1;
  a.frames = 90;
  a.frames_with_board = 80;
  a.views = 12;
  a.columns = 2;
  a.rows = 3;
  a.cells = 6;
  a.points_in_cell = {0, 1, 2, 3, 4, 5};
  a.count = 2;
  a.points_px = {{1.5, 2}, {-3, 4}};
  const calibration_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.monotonic_ns, b.monotonic_ns);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  EXPECT_EQ(a.advice, b.advice);
  EXPECT_EQ(a.enough, b.enough);
  EXPECT_EQ(a.frames, b.frames);
  EXPECT_EQ(a.frames_with_board, b.frames_with_board);
  EXPECT_EQ(a.views, b.views);
  EXPECT_EQ(a.columns, b.columns);
  EXPECT_EQ(a.rows, b.rows);
  EXPECT_EQ(a.points_in_cell, b.points_in_cell);
  EXPECT_EQ(a.points_px, b.points_px);
}

TEST(LcmTypes, PoseRoundTrip) {
  pose_t a{};
  a.utime = 1'700'000'000'000'001;
  a.monotonic_ns = -2;
  a.sequence = 3;
  a.status = pose_t::STATUS_RELOCALIZING;
  a.reason = "no marker in view";
  a.source = pose_t::SOURCE_PREDICTION;
  a.had_pose = 1;
  a.last_pose_age_ns = 6;
  fill(a.p_w_c, 7.0);
  fill(a.q_w_c, 8.0);
  fill(a.covariance, 9.0);
  fill(a.view_covariance, 14.0);
  a.markers_used = 10;
  a.reprojection_rms_px = 0.11;
  a.ambiguity_ratio = 12.5;
  a.latency_ns = 13;
  a.map_piece = 15;

  const pose_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.monotonic_ns, b.monotonic_ns);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.reason, b.reason);
  EXPECT_EQ(a.source, b.source);
  EXPECT_EQ(a.had_pose, b.had_pose);
  EXPECT_EQ(a.last_pose_age_ns, b.last_pose_age_ns);
  expectSame(a.p_w_c, b.p_w_c);
  expectSame(a.q_w_c, b.q_w_c);
  expectSame(a.covariance, b.covariance);
  expectSame(a.view_covariance, b.view_covariance);
  EXPECT_EQ(a.markers_used, b.markers_used);
  EXPECT_EQ(a.reprojection_rms_px, b.reprojection_rms_px);
  EXPECT_EQ(a.ambiguity_ratio, b.ambiguity_ratio);
  EXPECT_EQ(a.latency_ns, b.latency_ns);
  EXPECT_EQ(a.map_piece, b.map_piece);
}

TEST(LcmTypes, JointRoundTrip) {
  joint_t a{};
  a.utime = 1;
  a.monotonic_ns = 2;
  a.sequence = 3;
  a.kind = joint_t::KIND_PARTED;
  a.map_piece = 4;
  a.into = 5;
  fill(a.p_into_piece, 6.0);
  fill(a.q_into_piece, 7.0);
  fill(a.covariance, 8.0);

  const joint_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.monotonic_ns, b.monotonic_ns);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.kind, b.kind);
  EXPECT_EQ(a.map_piece, b.map_piece);
  EXPECT_EQ(a.into, b.into);
  expectSame(a.p_into_piece, b.p_into_piece);
  expectSame(a.q_into_piece, b.q_into_piece);
  expectSame(a.covariance, b.covariance);
}

TEST(LcmTypes, DetectionsRoundTrip) {
  detections_t a{};
  a.utime = 1;
  a.monotonic_ns = 2;
  a.sequence = 3;
  a.dictionary = "APRILTAG_36h11";
  a.seen = 5;
  a.count = 2;
  a.detections.resize(2);
  for (int i = 0; i < 2; ++i) {
    detection_t& d = a.detections[static_cast<std::size_t>(i)];
    d.id = 40 + i;
    d.hamming = i;
    for (int k = 0; k < 4; ++k) fill(d.corners_px[k], 100.0 * i + 10.0 * k);
  }

  const detections_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.monotonic_ns, b.monotonic_ns);
  EXPECT_EQ(a.sequence, b.sequence);
  EXPECT_EQ(a.dictionary, b.dictionary);
  EXPECT_EQ(a.seen, b.seen);
  ASSERT_EQ(b.count, 2);
  ASSERT_EQ(b.detections.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(a.detections[i].id, b.detections[i].id);
    EXPECT_EQ(a.detections[i].hamming, b.detections[i].hamming);
    for (int k = 0; k < 4; ++k) {
      expectSame(a.detections[i].corners_px[k], b.detections[i].corners_px[k]);
    }
  }
}

TEST(LcmTypes, MapRoundTrip) {
  map_t a{};
  a.utime = 1;
  a.monotonic_ns = 2;
  a.revision = 3;
  a.piece = 1;
  a.piece_count = 4;
  a.dictionary = "4X4_50";
  a.marker_count = 1500;
  a.keyframe_count = 7;
  a.count = 1;
  a.markers.resize(1);
  a.markers[0].id = 8;
  a.markers[0].size = 0.165;
  fill(a.markers[0].p_w_m, 9.0);
  fill(a.markers[0].q_w_m, 10.0);
  fill(a.markers[0].covariance, 11.0);
  a.markers[0].map_piece = 12;
  a.markers[0].state = marker_t::STATE_UNDECIDED;
  a.markers[0].views = 12;
  a.markers[0].sigma_m = 0.013;
  a.unposed_count = 1;
  a.unposed.resize(1);
  a.unposed[0].id = 14;
  a.unposed[0].size = 0.15;
  a.unposed[0].state = unposed_marker_t::STATE_ELSEWHERE;
  a.unposed[0].views = 16;
  a.markers[0].map_piece = 12;

  const map_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.monotonic_ns, b.monotonic_ns);
  EXPECT_EQ(a.revision, b.revision);
  EXPECT_EQ(a.piece, b.piece);
  EXPECT_EQ(a.piece_count, b.piece_count);
  EXPECT_EQ(a.dictionary, b.dictionary);
  EXPECT_EQ(a.marker_count, b.marker_count);
  EXPECT_EQ(a.keyframe_count, b.keyframe_count);
  ASSERT_EQ(b.count, 1);
  ASSERT_EQ(b.markers.size(), 1u);
  EXPECT_EQ(a.markers[0].id, b.markers[0].id);
  EXPECT_EQ(a.markers[0].size, b.markers[0].size);
  expectSame(a.markers[0].p_w_m, b.markers[0].p_w_m);
  expectSame(a.markers[0].q_w_m, b.markers[0].q_w_m);
  expectSame(a.markers[0].covariance, b.markers[0].covariance);
  EXPECT_EQ(a.markers[0].map_piece, b.markers[0].map_piece);
  EXPECT_EQ(a.markers[0].state, b.markers[0].state);
  EXPECT_EQ(a.markers[0].views, b.markers[0].views);
  EXPECT_EQ(a.markers[0].sigma_m, b.markers[0].sigma_m);
  ASSERT_EQ(b.unposed.size(), 1u);
  EXPECT_EQ(a.unposed[0].id, b.unposed[0].id);
  EXPECT_EQ(a.unposed[0].size, b.unposed[0].size);
  EXPECT_EQ(a.unposed[0].state, b.unposed[0].state);
  EXPECT_EQ(a.unposed[0].views, b.unposed[0].views);
  EXPECT_EQ(a.markers[0].map_piece, b.markers[0].map_piece);
}

TEST(LcmTypes, HealthRoundTrip) {
  health_t a{};
  a.utime = 1;
  a.monotonic_ns = 2;
  a.uptime_ns = 3;
  a.version = "1.2.3";
  a.status = pose_t::STATUS_NO_CAMERA;
  a.reason = "no frames";
  a.camera = health_t::CAMERA_LOST;
  a.camera_reason = "/dev/video0: unplugged";
  a.period_s = 1.5;
  a.frame_rate_hz = 150.0;
  a.pose_rate_hz = 149.0;
  a.latency_median_ns = 4;
  a.latency_p99_ns = 5;
  a.latency_max_ns = 6;
  a.processing_median_ns = 7;
  a.processing_max_ns = 8;
  a.counter_count = 2;
  a.counters.resize(2);
  a.counters[0].name = "dropped.queue";
  a.counters[0].value = 9;
  a.counters[1].name = "deadline.missed";
  a.counters[1].value = 10;
  a.temperature_count = 1;
  a.temperatures.resize(1);
  a.temperatures[0].name = "cpu";
  a.temperatures[0].celsius = 41.5;
  a.lens.state = lens_t::STATE_LEARNED;
  a.lens.model = lens_t::MODEL_EQUIDISTANT;
  a.lens.width = 640;
  a.lens.height = 480;
  a.lens.fx = 502.5;
  a.lens.fy = 502.6;
  a.lens.cx = 320.1;
  a.lens.cy = 240.2;
  fill(a.lens.distortion, -0.3);
  a.lens.focal_sigma = 0.0004;
  a.lens.rms_before_px = 1.6;
  a.lens.rms_after_px = 0.06;
  a.lens.changes = 3;

  const health_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.monotonic_ns, b.monotonic_ns);
  EXPECT_EQ(a.uptime_ns, b.uptime_ns);
  EXPECT_EQ(a.version, b.version);
  EXPECT_EQ(a.status, b.status);
  EXPECT_EQ(a.reason, b.reason);
  EXPECT_EQ(a.camera, b.camera);
  EXPECT_EQ(a.camera_reason, b.camera_reason);
  EXPECT_EQ(a.period_s, b.period_s);
  EXPECT_EQ(a.frame_rate_hz, b.frame_rate_hz);
  EXPECT_EQ(a.pose_rate_hz, b.pose_rate_hz);
  EXPECT_EQ(a.latency_median_ns, b.latency_median_ns);
  EXPECT_EQ(a.latency_p99_ns, b.latency_p99_ns);
  EXPECT_EQ(a.latency_max_ns, b.latency_max_ns);
  EXPECT_EQ(a.processing_median_ns, b.processing_median_ns);
  EXPECT_EQ(a.processing_max_ns, b.processing_max_ns);
  EXPECT_EQ(a.lens.state, b.lens.state);
  EXPECT_EQ(a.lens.model, b.lens.model);
  EXPECT_EQ(a.lens.width, b.lens.width);
  EXPECT_EQ(a.lens.height, b.lens.height);
  EXPECT_EQ(a.lens.fx, b.lens.fx);
  EXPECT_EQ(a.lens.fy, b.lens.fy);
  EXPECT_EQ(a.lens.cx, b.lens.cx);
  EXPECT_EQ(a.lens.cy, b.lens.cy);
  expectSame(a.lens.distortion, b.lens.distortion);
  EXPECT_EQ(a.lens.focal_sigma, b.lens.focal_sigma);
  EXPECT_EQ(a.lens.rms_before_px, b.lens.rms_before_px);
  EXPECT_EQ(a.lens.rms_after_px, b.lens.rms_after_px);
  EXPECT_EQ(a.lens.changes, b.lens.changes);
  ASSERT_EQ(b.counters.size(), 2u);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(a.counters[i].name, b.counters[i].name);
    EXPECT_EQ(a.counters[i].value, b.counters[i].value);
  }
  ASSERT_EQ(b.temperatures.size(), 1u);
  EXPECT_EQ(a.temperatures[0].name, b.temperatures[0].name);
  EXPECT_EQ(a.temperatures[0].celsius, b.temperatures[0].celsius);
}

TEST(LcmTypes, BotCorePoseRoundTrip) {
  bot_core::pose_t a{};
  a.utime = 1;
  fill(a.pos, 2.0);
  fill(a.vel, 3.0);
  fill(a.orientation, 4.0);
  fill(a.rotation_rate, 5.0);
  fill(a.accel, 6.0);

  const bot_core::pose_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  expectSame(a.pos, b.pos);
  expectSame(a.vel, b.vel);
  expectSame(a.orientation, b.orientation);
  expectSame(a.rotation_rate, b.rotation_rate);
  expectSame(a.accel, b.accel);
}

TEST(LcmTypes, BotCoreImageRoundTrip) {
  bot_core::image_t a{};
  a.utime = 1;
  a.width = 4;
  a.height = 2;
  a.row_stride = 5;
  a.pixelformat = bot_core::image_t::PIXEL_FORMAT_GRAY;
  a.data = {1, 2, 3, 4, 0, 5, 6, 7, 8, 255};
  a.size = static_cast<std::int32_t>(a.data.size());
  a.metadata.resize(1);
  a.nmetadata = 1;
  a.metadata[0].key = "sequence";
  a.metadata[0].value = {42, 43};
  a.metadata[0].n = 2;

  const bot_core::image_t b = throughTheWire(a);
  EXPECT_EQ(a.utime, b.utime);
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  EXPECT_EQ(a.row_stride, b.row_stride);
  EXPECT_EQ(a.pixelformat, b.pixelformat);
  EXPECT_EQ(a.size, b.size);
  EXPECT_EQ(a.data, b.data);
  ASSERT_EQ(b.metadata.size(), 1u);
  EXPECT_EQ(a.metadata[0].key, b.metadata[0].key);
  EXPECT_EQ(a.metadata[0].n, b.metadata[0].n);
  EXPECT_EQ(a.metadata[0].value, b.metadata[0].value);
}

}  // namespace
}  // namespace waymark
