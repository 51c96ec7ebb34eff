#include "tools/diagnosis/source_report.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::diagnosis {
namespace {

using Level = Finding::Level;

std::vector<std::int64_t> even(int frames, std::int64_t period_ns) {
  std::vector<std::int64_t> times;
  for (int i = 0; i < frames; ++i) times.push_back(i * period_ns);
  return times;
}

bool says(const Finding& finding, const std::string& what) {
  return finding.text.find(what) != std::string::npos;
}

TEST(SourceReport, EvenTimesAreGood) {
  const Finding finding = timesFinding(even(100, 10'000'000), 100.0);
  EXPECT_EQ(finding.level, Level::kGood);
  EXPECT_EQ(formatFinding(finding),
            "good  times      100 frames at 100.0 Hz, 95 % within 0.0 ms of it\n");
}

TEST(SourceReport, GapsJitterAndSlowCameras) {
  std::vector<std::int64_t> times = even(100, 10'000'000);
  times.erase(times.begin() + 50);
  EXPECT_TRUE(says(timesFinding(times, 100.0), "1 gaps, the longest of 20 ms"));
  times = even(100, 10'000'000);
  for (std::size_t i = 0; i < times.size(); i += 3) times[i] += 4'000'000;
  EXPECT_TRUE(says(timesFinding(times, 100.0), "uneven"));
  EXPECT_TRUE(says(timesFinding(even(100, 66'000'000), 30.0), "30 Hz are promised"));
  times = even(10, 10'000'000);
  times[5] = times[4];
  EXPECT_EQ(timesFinding(times, 0.0).level, Level::kBad);
  EXPECT_EQ(timesFinding(even(2, 1), 0.0).level, Level::kNote);
}

TEST(SourceReport, LightAndFocus) {
  ImageQuality quality{.dark = 20, .median = 90, .bright = 220, .edge_width_px = 2.2};
  for (const Finding& finding : qualityFindings(quality)) EXPECT_EQ(finding.level, Level::kGood);
  quality.edge_width_px = 9.0;
  auto found = qualityFindings(quality);
  EXPECT_EQ(found.at(0).level, Level::kGood);
  EXPECT_EQ(found.at(1).level, Level::kBad);
  quality.bright = 30;
  found = qualityFindings(quality);
  EXPECT_EQ(found.at(0).level, Level::kBad);
  EXPECT_TRUE(says(found.at(1), "sharp"));
}

TEST(SourceReport, TheLensThatWasGivenAndTheOneThatIsLearned) {
  slam::LensKnowledge known{
      .given = slam::CameraModel({.width = 640, .height = 480, .fx = 400.0, .fy = 400.0})};
  EXPECT_EQ(lensFinding("calib.yml", known, 400.0).level, Level::kGood);
  EXPECT_TRUE(says(lensFinding("calib.yml", known, 400.0), "calib.yml fits"));
  Finding nothing = lensFinding("", known, 400.0);
  EXPECT_EQ(nothing.level, Level::kNote);
  EXPECT_TRUE(says(nothing, "no calibration, and too little to learn it: come nearer"));

  known.state = slam::LensState::kLearning;
  known.rms_given_px = 1.6;
  known.rms_after_px = 0.06;
  known.covariance(0, 0) = 25.0;
  known.focal_px = 500.0;
  const Finding wrong = lensFinding("calib.yml", known, 502.4);
  EXPECT_EQ(wrong.level, Level::kBad);
  EXPECT_TRUE(says(wrong,
                   "calib.yml does not fit these images: RMS 1.60 px, 0.06 with what was learned, "
                   "focal length 502.4 instead of 400.0"));
  known.refines_given = true;
  const Finding better = lensFinding("calib.yml", known, 502.4);
  EXPECT_EQ(better.level, Level::kGood);
  EXPECT_TRUE(says(better, "calib.yml fits, and the markers know it better")) << better.text;
  nothing = lensFinding("", known, 502.4);
  EXPECT_EQ(nothing.level, Level::kNote);
  EXPECT_TRUE(says(nothing, "502.4 px to 1.00 %: come nearer"));
  known.state = slam::LensState::kLearned;
  EXPECT_EQ(lensFinding("", known, 502.4).level, Level::kGood);
}

TEST(SourceReport, Families) {
  const FamilyCount april{
      .dictionary = "APRILTAG_36h11", .markers = 40, .images = 8, .ids = {1, 2}};
  const FamilyCount other{.dictionary = "4X4_50", .markers = 3, .images = 1, .ids = {1}};
  auto found = familyFindings(std::vector{april, other}, {}, 8, "APRILTAG_36h11");
  ASSERT_EQ(found.size(), 2U);
  EXPECT_EQ(found[0].level, Level::kGood);
  EXPECT_EQ(found[1].level, Level::kNote);
  found = familyFindings(std::vector{april}, {}, 8, "4X4_50");
  EXPECT_EQ(found[0].level, Level::kBad);
  EXPECT_TRUE(says(found[0], "asked for was 4X4_50"));
  EXPECT_TRUE(says(familyFindings({}, {.mirrored = april}, 8, "")[0], "mirrored"));
  EXPECT_TRUE(says(familyFindings({}, {.inverted = april}, 8, "")[0], "white on black"));
  EXPECT_TRUE(says(familyFindings({}, {}, 8, "")[0], "none of any family in 8 images"));
}

TEST(SourceReport, Motion) {
  EXPECT_EQ(motionFinding({}).level, Level::kNote);
  EXPECT_EQ(motionFinding({1.0, 2.0, 3.0}).level, Level::kGood);
  EXPECT_EQ(motionFinding({50.0, 60.0, 70.0}).level, Level::kNote);
}

}  // namespace
}  // namespace waymark::diagnosis
