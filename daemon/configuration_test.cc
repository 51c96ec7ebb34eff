#include "daemon/configuration.h"

#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::daemon {
namespace {

const std::string kCamera = "[camera]\nsource = \"sim:walls\"\n";
const std::string kSlam = "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = 0.1\n";

std::string errorOf(const std::string& text) {
  const Result<Configuration> result = parseConfiguration(text, "/etc/w.toml");
  return result ? "no error" : result.error().message;
}

TEST(Configuration, TheCommentedExampleIsValid) {
  const Result<Configuration> c = readConfiguration(WAYMARK_EXAMPLE_CONFIGURATION);
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->camera.source, "sim:walls");
  EXPECT_EQ(c->camera.rate_hz, 150.0);
  EXPECT_EQ(c->slam.dictionary, "ARUCO_MIP_36h12");
  EXPECT_EQ(c->slam.options.markers.size_m, 0.165);
}

std::string readFile(const char* path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

// "# key = value" becomes "key = value"; prose stays a comment, and so does the calibration, which
// the example's simulated camera brings itself.
std::string uncommented(const std::string& text) {
  return std::regex_replace(text, std::regex("(^|\n)# (?!calibration)([a-z_.0-9]+ = )"), "$1$2");
}

TEST(Configuration, TheMapAcrossRestarts) {
  const auto c = parseConfiguration(kCamera + kSlam + "map_in = \"m.json\"\nlocalize_only = true\n",
                                    "/etc/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->slam.map.in, "/etc/m.json");
  EXPECT_TRUE(c->slam.map.localize_only);
  EXPECT_FALSE(c->slam.options.mapping);
  EXPECT_EQ(errorOf(kCamera + kSlam + "localize_only = true\n"),
            "/etc/w.toml: slam.localize_only: needs slam.map_in");
  EXPECT_EQ(errorOf(kCamera + kSlam + "localize_only = true\nmap_in = 'a'\nmap_out = 'a'\n"),
            "/etc/w.toml: slam.map_out: with localize_only nothing changes");
}

TEST(Configuration, NaturalMarkers) {
  const std::string sign = "[[natural]]\nname = \"exit\"\nimage = \"exit.png\"\nwidth_m = 0.3\n";
  const std::string place = "p_m = [2.0, 0.0, 1.5]\nq_wxyz = [0.0, 1.0, 0.0, 0.0]\n";
  const std::string poster =
      "[[natural]]\nname = \"poster\"\nimage = \"/p/poster.png\"\nwidth_m = 0.6\nheight_m = 0.8\n";
  const auto c = parseConfiguration(
      kCamera + kSlam + sign + place + poster + "[relocalizer]\ncore_share = 0.25\n",
      "/etc/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  ASSERT_EQ(c->natural.size(), 2U);
  EXPECT_EQ(c->natural[0].name, "exit");
  EXPECT_EQ(c->natural[0].image, "/etc/exit.png");
  EXPECT_TRUE(c->natural[0].has_position && c->natural[0].has_orientation);
  EXPECT_EQ(c->natural[0].T_w_m.p.z(), 1.5);
  EXPECT_EQ(c->natural[1].image, "/p/poster.png");
  EXPECT_EQ(c->natural[1].height_m, 0.8);
  EXPECT_FALSE(c->natural[1].has_position);
  EXPECT_EQ(c->relocalizer.core_share, 0.25);
  const std::string file = "[relocalizer]\nmarkers = \"posters.json\"\n";
  EXPECT_EQ(parseConfiguration(kCamera + kSlam + file, "/etc/w.toml")->relocalizer.markers,
            "/etc/posters.json");
  EXPECT_EQ(errorOf(kCamera + kSlam + sign + file),
            "/etc/w.toml: relocalizer.markers: [[natural]] has some already; one of the two");
  EXPECT_EQ(errorOf(kCamera + kSlam + sign + "p_m = [2.0, 0.0, 1.5]\n"),
            "/etc/w.toml: natural \"exit\": p_m and q_wxyz go together");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[slam.natural]\nenabled = false\n" + sign),
            "/etc/w.toml: natural: needs slam.natural.enabled");
  EXPECT_NE(errorOf(kCamera + kSlam + "[[natural]]\nname = \"exit\"\nwidth_m = 0.3\n")
                .find("image: missing"),
            std::string::npos);
  EXPECT_EQ(io::parseSlamSettings(kSlam + sign + file, "w.toml").ok(), true)
      << "others pass it over";
}

// What `waymark run --config` gets of the same file.
TEST(Configuration, TheSlamSectionReadsTheSameAlone) {
  const Result<io::SlamSettings> slam = io::readSlamSettings(WAYMARK_EXAMPLE_CONFIGURATION);
  ASSERT_TRUE(slam) << slam.error().message;
  EXPECT_EQ(slam->dictionary, "ARUCO_MIP_36h12");
  EXPECT_EQ(slam->options.markers.size_m, 0.165);
}

// The defaults that the example names are the true ones.
TEST(Configuration, TheExampleWithEverythingUncommentedChangesNoDefault) {
  const Result<Configuration> c =
      parseConfiguration(uncommented(readFile(WAYMARK_EXAMPLE_CONFIGURATION)), "w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->camera.simulator.truth_dir, "truth") << "nothing was uncommented";
  const Configuration d;
  EXPECT_EQ(c->camera.simulator.seed, d.camera.simulator.seed);
  EXPECT_EQ(c->camera.simulator.width, d.camera.simulator.width);
  EXPECT_EQ(c->camera.simulator.height, d.camera.simulator.height);
  EXPECT_EQ(c->camera.simulator.loop_s, d.camera.simulator.loop_s);
  const slam::Options& o = c->slam.options;
  const slam::Options& e = d.slam.options;
  EXPECT_EQ(o.detector.scanner.quads.min_side_px, e.detector.scanner.quads.min_side_px);
  EXPECT_EQ(o.detector.edges.fit.min_contrast, e.detector.edges.fit.min_contrast);
  EXPECT_EQ(o.detector.decoder.max_wrong_bits, e.detector.decoder.max_wrong_bits);
  EXPECT_EQ(o.detector.decoder.min_likeness, e.detector.decoder.min_likeness);
  EXPECT_EQ(o.follower.enabled, e.follower.enabled);
  EXPECT_EQ(o.follower.schedule.round_s, e.follower.schedule.round_s);
  EXPECT_EQ(o.work_per_frame, e.work_per_frame);
  EXPECT_EQ(o.pieces.begin, e.pieces.begin);
  EXPECT_TRUE(o.pieces.begin);
  EXPECT_EQ(o.pieces.max_pieces, e.pieces.max_pieces);
  EXPECT_EQ(o.covariance.enabled, e.covariance.enabled);
  EXPECT_EQ(o.natural.enabled, e.natural.enabled);
  EXPECT_EQ(o.natural.filter.filter.max_features, e.natural.filter.filter.max_features);
  EXPECT_EQ(o.natural.integrator.max_markers, e.natural.integrator.max_markers);
  EXPECT_EQ(o.natural.integrator.max_prediction_s, e.natural.integrator.max_prediction_s);
  EXPECT_EQ(o.natural.integrator.max_error_m, e.natural.integrator.max_error_m);
  EXPECT_EQ(o.natural.integrator.max_error_rad, e.natural.integrator.max_error_rad);
  EXPECT_EQ(o.natural.integrator.start.border, e.natural.integrator.start.border);
  EXPECT_EQ(o.natural.integrator.start.min_area, e.natural.integrator.start.min_area);
  EXPECT_EQ(o.natural.integrator.start.max_area, e.natural.integrator.start.max_area);
  EXPECT_EQ(o.covariance.cost_per_frame, e.covariance.cost_per_frame);
  EXPECT_EQ(o.markers.constraints.gate_sigmas, e.markers.constraints.gate_sigmas);
  EXPECT_EQ(c->relocalizer.core_share, d.relocalizer.core_share);
  EXPECT_EQ(o.initialization.ambiguity_ratio, e.initialization.ambiguity_ratio);
  EXPECT_EQ(o.tracking.pose.marker_chi2, e.tracking.pose.marker_chi2);
  EXPECT_EQ(o.tracking.pose.max_rms_px, e.tracking.pose.max_rms_px);
  EXPECT_EQ(o.tracking.motion.max_extrapolation_s, e.tracking.motion.max_extrapolation_s);
  EXPECT_EQ(o.mapper.keyframes.min_baseline_m, e.mapper.keyframes.min_baseline_m);
  EXPECT_EQ(o.mapper.keyframes.min_baseline_per_depth, e.mapper.keyframes.min_baseline_per_depth);
  EXPECT_EQ(o.mapper.keyframes.min_rotation_rad, e.mapper.keyframes.min_rotation_rad);
  EXPECT_EQ(o.mapper.keyframes.views_per_marker, e.mapper.keyframes.views_per_marker);
  EXPECT_EQ(o.mapper.marker_pose.min_views, e.mapper.marker_pose.min_views);
  EXPECT_EQ(o.mapper.marker_pose.ambiguity_ratio, e.mapper.marker_pose.ambiguity_ratio);
  EXPECT_EQ(o.tracking.relocalization.ambiguity_ratio, e.tracking.relocalization.ambiguity_ratio);
  EXPECT_EQ(o.mapper.local_optimization.max_iterations, e.mapper.local_optimization.max_iterations);
  EXPECT_EQ(c->slam.map.save_interval_s, d.slam.map.save_interval_s);
  EXPECT_EQ(c->control.socket, "/run/waymark/control.sock");
  EXPECT_EQ(c->queue.depth, d.queue.depth);
  EXPECT_EQ(c->publish.url, d.publish.url);
  EXPECT_EQ(c->publish.channel_prefix, d.publish.channel_prefix);
  EXPECT_EQ(c->publish.pose_channel, d.publish.pose_channel);
  EXPECT_EQ(c->publish.detections, d.publish.detections);
  EXPECT_EQ(c->publish.map_interval_s, d.publish.map_interval_s);
  EXPECT_EQ(c->log.level, d.log.level);
}

// Every key of the example, commented out or not, with its section.
std::set<std::string> exampleKeys() {
  const std::regex section(R"(#? *\[\[?([a-z_.]+)\]\]?.*)");
  const std::regex key(R"(#? *([a-z_.0-9]+) = .*)");
  std::set<std::string> keys;
  std::istringstream text(readFile(WAYMARK_EXAMPLE_CONFIGURATION));
  std::string prefix;
  std::smatch found;
  for (std::string line; std::getline(text, line);) {
    if (std::regex_match(line, found, section)) prefix = found[1].str() + ".";
    if (std::regex_match(line, found, key)) keys.insert(prefix + found[1].str());
  }
  return keys;
}

// Those of lists of sections with their section.
std::set<std::string> parserKeys() {
  Configuration configuration;
  std::set<std::string> keys;
  for (const io::Setting& setting : configurationKeys(configuration)) {
    if (!setting.renamed_to.empty()) continue;
    if (!setting.element) keys.insert(setting.key);
    if (!setting.element) continue;
    for (const io::Setting& of_element : setting.element()) {
      keys.insert(setting.key + "." + of_element.key);
    }
  }
  return keys;
}

TEST(Configuration, TheExampleHasEveryKeyOfTheParserAndNoOther) {
  const std::string controls = "camera.controls";  // a section whose keys the camera knows
  std::set<std::string> example;
  for (const std::string& key : exampleKeys()) {
    example.insert(key.starts_with(controls + ".") ? controls : key);
  }
  const std::set<std::string> parser = parserKeys();
  for (const std::string& key : parser) EXPECT_TRUE(example.contains(key)) << key;
  for (const std::string& key : example) EXPECT_TRUE(parser.contains(key)) << key;
}

TEST(Configuration, RenamedKeysLeadToKeysThereAre) {
  const std::set<std::string> parser = parserKeys();
  Configuration configuration;
  int renamed = 0;
  for (const io::Setting& setting : configurationKeys(configuration)) {
    if (setting.renamed_to.empty()) continue;
    ++renamed;
    EXPECT_TRUE(parser.contains(setting.renamed_to)) << setting.renamed_to;
    EXPECT_FALSE(parser.contains(setting.key)) << setting.key;
  }
  EXPECT_GT(renamed, 0);
  EXPECT_EQ(errorOf(kCamera + kSlam + "[slam.keyframes]\nmin_baseline_m = 0.1\n"),
            "/etc/w.toml:7:1: slam.keyframes.min_baseline_m is now "
            "slam.mapper.keyframes.min_baseline_m");
}

TEST(Configuration, ReadsEveryKindOfValue) {
  const Result<Configuration> c = parseConfiguration(
      "[camera]\nsource = \"a/b.avi\"\ncalibration = \"c.yml\"\nrate_hz = 30\n" + kSlam +
          "[publish]\ndetections = false\nmap_interval_s = 0.5\n[log]\nlevel = "
          "\"debug\"\n[queue]\ndepth = 1\n",
      "/etc/waymark/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->camera.source, "/etc/waymark/a/b.avi");
  EXPECT_EQ(c->camera.calibration, "/etc/waymark/c.yml");
  EXPECT_EQ(c->camera.rate_hz, 30.0);
  EXPECT_FALSE(c->publish.detections);
  EXPECT_EQ(c->publish.map_interval_s, 0.5);
  EXPECT_EQ(c->log.level, LogLevel::kDebug);
  EXPECT_EQ(c->queue.depth, 1);
}

TEST(Configuration, SourcesWithASchemeAreNoPaths) {
  const Result<Configuration> c =
      parseConfiguration("[camera]\nsource = \"sim:lab\"\n" + kSlam, "/etc/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->camera.source, "sim:lab");
}

TEST(Configuration, ACameraAndWhatIsAskedOfIt) {
  const std::string camera = "[camera]\nsource = \"v4l2:bus=usb-1\"\ncalibration = \"c.yml\"\n";
  const Result<Configuration> c = parseConfiguration(
      camera + "format = 'GREY'\nwidth = 1280\nheight = 800\nbuffers = 6\nexposure_s = 0.004\n" +
          "[camera.controls]\ngain = 40\nfocus_automatic_continuous = false\n" + kSlam,
      "/etc/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->camera.source, "v4l2:bus=usb-1") << "no path";
  const capture::CameraOptions& device = c->camera.device;
  EXPECT_EQ(device.format, "GREY");
  EXPECT_EQ(device.width, 1280);
  EXPECT_EQ(device.height, 800);
  EXPECT_EQ(device.buffers, 6);
  EXPECT_EQ(device.exposure_s, 0.004);
  EXPECT_EQ(device.controls,
            (std::map<std::string, capture::ControlValue>{{"gain", std::int64_t{40}},
                                                          {"focus_automatic_continuous", false}}));
  EXPECT_EQ(errorOf(camera + "width = 640\n" + kSlam),
            "/etc/w.toml: camera: width and height go together");
  EXPECT_EQ(errorOf(kCamera + "buffers = 8\n" + kSlam),
            "/etc/w.toml: camera: format, width, height, buffers, exposure_s and controls are for "
            "cameras, which \"sim:walls\" is not");
}

TEST(Configuration, ErrorsNamePlaceKeyAndReason) {
  EXPECT_EQ(errorOf(kCamera + "ratehz = 3\n" + kSlam),
            "/etc/w.toml:3:1: camera.ratehz: unknown key; did you mean camera.rate_hz?");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publisher]\nurl = 3\n"),
            "/etc/w.toml:6:2: publisher: unknown key; did you mean publish?");
  EXPECT_EQ(errorOf(kCamera + "rate_hz = \"fast\"\n" + kSlam),
            "/etc/w.toml:3:11: camera.rate_hz: must be a number");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[queue]\ndepth = 0\n"),
            "/etc/w.toml:7:9: queue.depth: must be from 1 to 64, not 0");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[queue]\ndepth = 1.5\n"),
            "/etc/w.toml:7:9: queue.depth: must be a whole number");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publish]\ndetections = 1\n"),
            "/etc/w.toml:7:14: publish.detections: must be true or false");
  EXPECT_EQ(errorOf("queue = 4\n" + kCamera + kSlam), "/etc/w.toml:1:9: queue: must be a section");
  EXPECT_EQ(
      errorOf(kCamera + kSlam + "[log]\nlevel = \"loud\"\n"),
      "/etc/w.toml:7:9: log.level: must be one of \"error\", \"warning\", \"info\", \"debug\"");
}

TEST(Configuration, RejectsImpossibleMarkers) {
  EXPECT_EQ(errorOf(kCamera + "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = 0\n"),
            "/etc/w.toml:5:17: slam.marker_size_m: must be from 0.001 to 100 m, not 0");
  EXPECT_EQ(errorOf(kCamera + "[slam]\ndictionary = \"4X4_50\"\nmarker_size_m = nan\n"),
            "/etc/w.toml:5:17: slam.marker_size_m: must be from 0.001 to 100 m, not nan");
  const std::string unknown =
      errorOf(kCamera + "[slam]\ndictionary = \"9X9\"\nmarker_size_m = 1\n");
  EXPECT_TRUE(unknown.starts_with(
      "/etc/w.toml:4:14: slam.dictionary: \"9X9\" is not a known dictionary; known are "))
      << unknown;
  EXPECT_EQ(errorOf(kCamera + kSlam + "[slam.markers]\norigin = 2\nignored = '1-3'\n"),
            "/etc/w.toml: slam: the origin marker is among the ignored ids");
}

TEST(Configuration, RejectsUnusableUrlsAndChannels) {
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publish]\nurl = \"udpm://10.0.0.1:1\"\n"),
            "/etc/w.toml:7:7: publish.url: must be like \"udpm://239.255.76.67:7667?ttl=0\" with a "
            "multicast address, not \"udpm://10.0.0.1:1\"");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[publish]\npose_channel = \"A B\"\n"),
            "/etc/w.toml:7:16: publish.pose_channel: must be at most 50 characters without spaces");
}

TEST(Configuration, UrlOptionsThatLcmWouldNotTake) {
  const auto of = [](const std::string& options) {
    return errorOf(kCamera + kSlam + "[publish]\nurl = \"udpm://239.255.76.67:1?" + options +
                   "\"\n");
  };
  EXPECT_EQ(of("ttl=1&recv_buf_size=100000"), "no error");
  EXPECT_EQ(of("ttl=256"), "/etc/w.toml:7:7: publish.url: its ttl must be from 0 to 255");
  EXPECT_EQ(of("tll=1"),
            "/etc/w.toml:7:7: publish.url: may have the options ttl and recv_buf_size, joined by "
            "\"&\", and not \"tll=1\"");
}

TEST(Configuration, OneChannelForEachKindOfMessage) {
  const std::string text = kCamera + kSlam;
  const std::string prefix = "[publish]\nchannel_prefix = \"A_\"\n";
  EXPECT_EQ(errorOf(text + "[publish]\npose_channel = \"WAYMARK_POSE\"\n"),
            "/etc/w.toml: publish.pose_channel: \"WAYMARK_POSE\" is another message's channel "
            "already");
  EXPECT_EQ(errorOf(text + prefix + "pose_channel = \"WAYMARK_POSE\"\n"), "no error");
  EXPECT_EQ(errorOf(text + prefix + "pose_channel = \"A_MAP\"\n"),
            "/etc/w.toml: publish.pose_channel: \"A_MAP\" is another message's channel already");
  for (const char* taken : {"POSE", "WAYMARK_HEALTH", "WAYMARK_FILE"}) {
    EXPECT_EQ(errorOf(text + "[record]\nimage_channel = \"" + taken + "\"\n"),
              "/etc/w.toml: record.image_channel: \"" + std::string(taken) +
                  "\" is another message's channel already");
  }
}

TEST(Configuration, MarkersThatTheDictionaryHas) {
  const std::string anchor = "[[slam.markers.anchors]]\np_m = [1, 2, 3]\nq_wxyz = [1, 0, 0, 0]\n";
  EXPECT_EQ(errorOf(kCamera + kSlam + anchor + "id = 49\n"), "no error");
  EXPECT_EQ(errorOf(kCamera + kSlam + anchor + "id = 50\n"),
            "/etc/w.toml: slam: anchor 50 is not in 4X4_50, whose ids are 0 to 49");
  EXPECT_EQ(errorOf(kCamera + kSlam + "[slam.markers]\norigin = 50\n"),
            "/etc/w.toml: slam: the origin marker 50 is not in 4X4_50, whose ids are 0 to 49");
  const std::string ids_are = " is not in 4X4_50, whose ids are 0 to 49";
  EXPECT_EQ(errorOf(kCamera + kSlam + "[[slam.markers.planes]]\nname = \"north\"\nids = '40-50'\n"),
            "/etc/w.toml: slam: plane \"north\": marker 50" + ids_are);
  EXPECT_EQ(errorOf(kCamera + kSlam + "[slam.markers.upright]\nids = '1, 77'\n"),
            "/etc/w.toml: slam: upright: marker 77" + ids_are);
}

TEST(Configuration, WhatIsKnownOfMarkersMustBeUsable) {
  const auto errorWith = [](const std::string& known) { return errorOf(kCamera + kSlam + known); };
  const std::string distance =
      "[[slam.markers.distances]]\nid_a = 1\ncorner_a = 0\nid_b = 2\ncorner_b = 3\n";
  EXPECT_EQ(errorWith(distance + "distance_m = 2.5\n"), "no error");
  EXPECT_EQ(errorWith(distance), "/etc/w.toml:6:1: slam.markers.distances.distance_m: missing");
  EXPECT_EQ(errorWith("[[slam.markers.planes]]\nids = '4'\n"),
            "/etc/w.toml: slam: plane 1: a plane needs at least two markers");
  EXPECT_EQ(errorWith("[[slam.markers.positions]]\nid = 4\np_m = [1, 2, 3]\n"),
            "/etc/w.toml: slam: positions without orientation fix the world from three on; or give "
            "an anchor");
  EXPECT_EQ(errorWith("[slam.markers]\nup = [0, 0, 1]\n"),
            "/etc/w.toml: slam: up is the vertical in a surveyed world; give anchors, positions or "
            "an origin marker");
}

TEST(Configuration, PathsWithoutNul) {
  EXPECT_EQ(errorOf(kCamera + kSlam + "map_out = \"a\\u0000b\"\n"),
            "/etc/w.toml:6:11: slam.map_out: must not contain NUL");
  EXPECT_EQ(errorOf("[camera]\nsource = \"sim:walls\\u0000\"\n" + kSlam),
            "/etc/w.toml:2:10: camera.source: must not contain NUL");
}

TEST(Configuration, SaysWhatIsMissing) {
  EXPECT_EQ(errorOf(kCamera), "/etc/w.toml: slam.dictionary: missing");
  EXPECT_EQ(errorOf(kSlam), "/etc/w.toml: camera.source: missing");
}

// The lens is learned then; but something has to say how large the pictures are, and nobody may
// have said that calibrations are exact.
TEST(Configuration, NeedsNoCalibration) {
  const Result<Configuration> c =
      parseConfiguration("[camera]\nsource = \"x.avi\"\nfov_deg = 90.0\n" + kSlam, "/etc/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_TRUE(lensIsUnknown(*c));
  EXPECT_FALSE(c->slam.options.lens.given);
  EXPECT_EQ(c->slam.options.lens.prior.focal_share, c->slam.options.lens.start.said_focal_share);
  EXPECT_EQ(c->slam.fov_deg, 90.0);
  EXPECT_EQ(errorOf("[camera]\nsource = \"x.avi\"\nlearn = false\n" + kSlam),
            "/etc/w.toml: camera.calibration: missing, and camera.learn is off");
  EXPECT_EQ(errorOf("[camera]\nsource = \"v4l2:/dev/video0\"\n" + kSlam),
            "/etc/w.toml: camera: width and height are missing, which no calibration says");
  EXPECT_EQ(errorOf("[camera]\nsource = \"x.avi\"\n" + kSlam +
                    "[relocalizer]\nmarkers = \"natural.json\"\n"),
            "/etc/w.toml: camera.calibration: missing; natural markers are looked for through a "
            "known lens");
  const Result<Configuration> known = parseConfiguration(
      "[camera]\nsource = \"x.avi\"\ncalibration = \"c.yml\"\n" + kSlam, "/etc/w.toml");
  ASSERT_TRUE(known) << known.error().message;
  EXPECT_FALSE(lensIsUnknown(*known));
  EXPECT_TRUE(known->slam.options.lens.given);
  EXPECT_TRUE(known->slam.options.lens.learn);
}

TEST(Configuration, ASimulatedCameraBringsItsOwnCalibration) {
  EXPECT_EQ(errorOf(kCamera + "calibration = \"calib.yml\"\n" + kSlam),
            "/etc/w.toml: camera.calibration: simulated cameras bring their own");
}

TEST(Configuration, SyntaxErrorsNameTheirLine) {
  const std::string message = errorOf("[camera]\nsource = \"sim:walls\n");
  EXPECT_TRUE(message.starts_with("/etc/w.toml:2:")) << message;
  EXPECT_EQ(message.find('\n'), message.npos) << "one line";
}

TEST(Configuration, FilesThatCannotBeRead) {
  EXPECT_EQ(readConfiguration("/nowhere/w.toml").error().message,
            "/nowhere/w.toml: cannot be read: No such file or directory");
  EXPECT_EQ(readConfiguration("/").error().message, "/: cannot be read: Is a directory");
}

TEST(Configuration, ProcessorsAreNamedOnce) {
  const std::string realtime = kCamera + kSlam + "[realtime]\nslam_cpus = ";
  const auto c = parseConfiguration(realtime + "\"0, 2-3\"\n", "/etc/w.toml");
  ASSERT_TRUE(c) << c.error().message;
  EXPECT_EQ(c->realtime.slam.cpus, (std::vector<int>{0, 2, 3}));
  EXPECT_NE(errorOf(realtime + "\"0-1024\"\n").find("must be processors from 0 to 1023"),
            std::string::npos);
  std::string many = "\"0-1023";
  for (int i = 0; i < 100'000; ++i) many += ",0-1023";
  EXPECT_NE(errorOf(realtime + many + "\"\n").find("must name each processor once"),
            std::string::npos);
}

}  // namespace
}  // namespace waymark::daemon
