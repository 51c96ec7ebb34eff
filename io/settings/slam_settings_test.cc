#include "io/settings/slam_settings.h"

#include <fstream>
#include <string>

#include <gtest/gtest.h>

#include "tests/temporary_directory.h"

namespace waymark::io {
namespace {

using testing::TemporaryDirectory;

Result<SlamSettings> read(const std::string& text) {
  const TemporaryDirectory directory;
  std::ofstream(directory / "w.toml") << text;
  return readSlamSettings(directory / "w.toml");
}

TEST(SlamSettings, NestAsTheOptionsDo) {
  const Result<SlamSettings> s = read(
      "[slam]\ndictionary = '4X4_50'\nmarker_size_m = 0.1\n"
      "[slam.detector]\nscanner.quads.min_side_px = 21\n"
      "[slam.mapper.keyframes]\nviews_per_marker = 7\n"
      "[slam.mapper.local_optimization]\nmax_iterations = 3\n");
  ASSERT_TRUE(s) << s.error().message;
  EXPECT_EQ(s->dictionary, "4X4_50");
  EXPECT_EQ(s->options.markers.size_m, 0.1);
  EXPECT_EQ(s->options.detector.scanner.quads.min_side_px, 21.0);
  EXPECT_EQ(s->options.mapper.keyframes.views_per_marker, 7);
  EXPECT_EQ(s->options.mapper.local_optimization.max_iterations, 3);
}

TEST(SlamSettings, OfAFileWithOtherSectionsOrNone) {
  const Result<SlamSettings> s = read(
      "[camera]\nsource = 'sim:walls'\nwhatever = 1\n[queue]\n[publish]\n[log]\n"
      "[slam]\nmarker_size_m = 0.2\n");
  ASSERT_TRUE(s) << s.error().message;
  EXPECT_EQ(s->dictionary, "");
  EXPECT_EQ(s->options.markers.size_m, 0.2);
  ASSERT_TRUE(read(""));
}

TEST(SlamSettings, Markers) {
  const Result<SlamSettings> s = read(
      "[slam.markers]\nignored = '3, 7-9'\n"
      "[[slam.markers.sizes]]\nids = '10-19'\nsize_m = 0.2\n"
      "[[slam.markers.sizes]]\nids = '42'\nsize_m = 0.05\n"
      "[[slam.markers.anchors]]\nid = 1\np_m = [1, 2.5, -3]\nq_wxyz = [0.707, 0, 0.707, 0]\n"
      "[[slam.markers.anchors]]\nid = 2\np_m = [0, 0, 0]\nq_wxyz = [1, 0, 0, 0]\n"
      "sigma_m = 0.02\nsigma_rad = 0.1\n");
  ASSERT_TRUE(s) << s.error().message;
  const slam::MarkerOptions& m = s->options.markers;
  EXPECT_TRUE(m.isIgnored(3) && m.isIgnored(8) && !m.isIgnored(4));
  EXPECT_EQ(m.sizeOf(15), 0.2);
  EXPECT_EQ(m.sizeOf(42), 0.05);
  ASSERT_EQ(m.anchors.size(), 2U);
  EXPECT_EQ(m.anchors[0].id, 1);
  EXPECT_EQ(m.anchors[0].T_w_m.p, Eigen::Vector3d(1.0, 2.5, -3.0));
  // A quarter turn about y takes z to x.
  EXPECT_LT((m.anchors[0].T_w_m.R.col(2) - Eigen::Vector3d::UnitX()).norm(), 1e-12);
  EXPECT_EQ(m.anchors[0].sigma_m, slam::Anchor{}.sigma_m);
  EXPECT_EQ(m.anchors[1].sigma_m, 0.02);
  EXPECT_EQ(m.anchors[1].sigma_rad, 0.1);
  EXPECT_FALSE(m.origin_marker.has_value());
  const Result<SlamSettings> origin = read("[slam]\nmarkers.origin = 5\n");
  ASSERT_TRUE(origin) << origin.error().message;
  EXPECT_EQ(origin->options.markers.origin_marker, 5);
}

TEST(SlamSettings, WhatIsKnownOfMarkers) {
  const Result<SlamSettings> s = read(
      "[slam.markers]\nup = [0, 0, 2]\ngate_sigmas = 4\n"
      "[[slam.markers.positions]]\nid = 3\np_m = [1, 2.5, -3]\n"
      "[[slam.markers.planes]]\nname = 'north'\nids = '10-19, 25'\nkind = 'wall'\n"
      "[[slam.markers.planes]]\nids = '1-2'\nsigma_m = 0.01\nsigma_rad = 0.1\n"
      "[slam.markers.upright]\nids = '10-12'\nsigma_rad = 0.03\n"
      "[[slam.markers.distances]]\nid_a = 10\ncorner_a = 1\nid_b = 19\ncorner_b = 2\n"
      "distance_m = 8.992\nsigma_m = 0.002\n");
  ASSERT_TRUE(s) << s.error().message;
  const slam::MarkerConstraints& known = s->options.markers.constraints;
  EXPECT_EQ(known.up_w, Eigen::Vector3d(0.0, 0.0, 2.0));
  EXPECT_EQ(known.gate_sigmas, 4.0);
  ASSERT_EQ(known.positions.size(), 1U);
  EXPECT_EQ(known.positions[0].p_w, Eigen::Vector3d(1.0, 2.5, -3.0));
  EXPECT_EQ(known.positions[0].sigma_m, slam::SurveyedPosition{}.sigma_m);
  ASSERT_EQ(known.planes.size(), 2U);
  EXPECT_EQ(known.planes[0].name, "north");
  EXPECT_EQ(known.planes[0].kind, slam::PlaneKind::kWall);
  ASSERT_EQ(known.planes[0].ids.size(), 2U);
  EXPECT_TRUE(known.planes[0].ids[0].contains(19));
  EXPECT_EQ(known.planes[0].sigma_m, slam::MarkerPlane{}.sigma_m);
  EXPECT_EQ(known.planes[1].kind, slam::PlaneKind::kAny);
  EXPECT_EQ(known.planes[1].sigma_m, 0.01);
  EXPECT_EQ(known.planes[1].sigma_rad, 0.1);
  ASSERT_EQ(known.upright.ids.size(), 1U);
  EXPECT_EQ(known.upright.sigma_rad, 0.03);
  ASSERT_EQ(known.distances.size(), 1U);
  EXPECT_EQ(known.distances[0].corner_a, 1);
  EXPECT_EQ(known.distances[0].corner_b, 2);
  EXPECT_EQ(known.distances[0].distance_m, 8.992);
  EXPECT_EQ(known.distances[0].sigma_m, 0.002);
}

TEST(SlamSettings, AKnownShutterIsNotLearned) {
  const Result<SlamSettings> unknown = read("[slam]\n");
  ASSERT_TRUE(unknown) << unknown.error().message;
  EXPECT_FALSE(unknown->options.shutter.readout_s);
  const Result<SlamSettings> known = read("[slam]\nshutter.readout_s = -0.02\n");
  ASSERT_TRUE(known) << known.error().message;
  EXPECT_EQ(known->options.shutter.readout_s, -0.02);
  EXPECT_FALSE(read("[slam]\nshutter.readout_s = 20\n")) << "milliseconds";
}

TEST(SlamSettings, ErrorsNameThePlace) {
  const auto ends = [](const std::string& text, const std::string& end) {
    const Result<SlamSettings> s = read(text);
    ASSERT_FALSE(s) << text;
    EXPECT_TRUE(s.error().message.ends_with(end)) << s.error().message;
  };
  ends("[slam]\nmarker_size = 1\n",
       "w.toml:2:1: slam.marker_size: unknown key; did you mean slam.marker_size_m?");
  ends("[slam]\nmarker_size_m = 'a'\n", "w.toml:2:17: slam.marker_size_m: must be a number");
  ends("[slam.keyframes]\nviews_per_marker = 7\n",
       "w.toml:2:1: slam.keyframes.views_per_marker is now slam.mapper.keyframes.views_per_marker");
  ends("[slam]\ntracking.worst_rms_px = 'a'\n",
       "w.toml:2:10: slam.tracking.worst_rms_px is now slam.tracking.pose.max_rms_px");
  ends("[slam.detector]\nscanner = 1\n", "w.toml:2:11: slam.detector.scanner: must be a section");
  ends("[slam.markers]\nignored = '3, x'\n",
       "w.toml:2:11: slam.markers.ignored: 'x' must be an id or a range of ids like 7-9");
  ends("[slam.markers]\nignored = 3\n", "2:11: slam.markers.ignored: must be text in quotes");
  ends("[slam.markers]\norigin = -1\n",
       "w.toml:2:10: slam.markers.origin: must be from 0 to 1000000, not -1");
  ends("[slam.markers]\nsizes = 3\n",
       "w.toml:2:9: slam.markers.sizes: must be sections [[slam.markers.sizes]]");
  const std::string sizes = "[[slam.markers.sizes]]\nids = '1'\nsize_m = 0.1\n";
  ends(sizes + "[[slam.markers.sizes]]\nids = '2,3'\n",
       "w.toml:5:7: slam.markers.sizes.ids: must be one id or one range of ids like \"7-9\"");
  ends(sizes + "[[slam.markers.sizes]]\nids = '2'\n", "slam.markers.sizes.size_m: missing");
  ends(sizes + "colour = 1\n", "w.toml:4:1: slam.markers.sizes.colour: unknown key");
  const std::string anchor = "[[slam.markers.anchors]]\nid = 1\np_m = [1, 2, 3]\n";
  ends(anchor + "q_wxyz = [1, 0, 0]\n",
       "w.toml:4:10: slam.markers.anchors.q_wxyz: must be a list of 4 numbers");
  ends(anchor + "q_wxyz = [1, 0, 0, 'a']\n", "q_wxyz: must be a list of 4 numbers");
  ends(anchor + "q_wxyz = [1, 0, 0, nan]\n", "q_wxyz: must be a list of 4 numbers");
  ends(anchor + "q_wxyz = [1, 0, 0, 1]\n", "slam.markers.anchors.q_wxyz: must have length 1");
  ends(anchor + "q_wxyz = [1, 0, 0, 0]\nsigma_m = 0\n", "must be from 1e-06 to 100 m, not 0");
  ends("[[slam.markers.planes]]\nids = '1-9'\nkind = 'roof'\n",
       "w.toml:3:8: slam.markers.planes.kind: must be one of \"any\", \"floor\", \"ceiling\", "
       "\"wall\"");
  ends("[[slam.markers.planes]]\nids = '1-x'\n",
       "w.toml:2:7: slam.markers.planes.ids: '1-x' must be an id or a range of ids like 7-9");
  ends("[[slam.markers.distances]]\ncorner_a = 4\n",
       "w.toml:2:12: slam.markers.distances.corner_a: must be from 0 to 3, not 4");
  ends("[[slam.markers.positions]]\np_m = [1, 2]\n",
       "w.toml:2:7: slam.markers.positions.p_m: must be a list of 3 numbers");
  ends("[slam.markers]\nup = 'z'\n", "slam.markers.up: must be a list of 3 numbers");
  ends("[slams]\n", "w.toml:1:2: slams: unknown key; did you mean slam?");
  EXPECT_EQ(readSlamSettings("/nowhere/w.toml").error().message,
            "/nowhere/w.toml: cannot be read: No such file or directory");
}

}  // namespace
}  // namespace waymark::io
