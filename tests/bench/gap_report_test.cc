#include "tests/bench/gap_report.h"

#include <cmath>

#include <gtest/gtest.h>

namespace waymark::bench {
namespace {

Gap gapOf(double error_m, std::optional<Scale> scale) {
  Gap gap{.begin_s = 2.0, .end_s = 5.0, .way_m = 2.0};
  gap.last = Carried{.error_m = error_m, .from_marker_m = error_m, .nees = 6.0, .scale = scale};
  gap.into[0] = gap.last;
  gap.frames = gap.posed = 30;
  return gap;
}

GapReport runOf(double error_m, std::optional<Scale> scale) {
  GapReport run;
  run.gaps = {gapOf(error_m, scale)};
  run.cpu_ms = {3.0, 1.0};
  run.features_ms = {1.5, 0.5};
  run.frames = run.posed = 100;
  run.mapped_first_way = 1;
  run.mapped = run.markers = 2;
  run.distance_errors_mm = {-4.0};
  return run;
}

TEST(GapReport, SumsUpAllRuns) {
  GapReport report;
  report.add(runOf(0.03, Scale{.error = 0.03, .sigma = 0.01}));
  report.add(runOf(0.04, Scale{.error = -0.04, .sigma = 0.01}));
  const io::Json summary = summaryOf("dolly", report);
  EXPECT_EQ(summary["scene"], "dolly");
  EXPECT_EQ(summary["frames"], 4);
  EXPECT_EQ(summary["posed_percent"], 100.0);
  EXPECT_EQ(summary["markers"]["mapped_first_way"], 2);
  EXPECT_EQ(summary["markers"]["mapped"], 4);
  EXPECT_EQ(summary["markers"]["all"], 4);
  EXPECT_EQ(summary["distance_off_mm"]["worst"], 4.0);
  EXPECT_EQ(summary["ends"]["gaps"], 2);
  EXPECT_EQ(summary["ends"]["lost"], 0);
  EXPECT_NEAR(summary["ends"]["from_marker_mm"]["rms"].get<double>(), std::sqrt(1250.0), 1e-9);
  EXPECT_EQ(summary["each"].size(), 2U);
  EXPECT_NEAR(summary["each"][0]["scale_sigma_percent"].get<double>(), 1.0, 1e-12);
}

TEST(GapReport, TellsWhatNaturalFeaturesTake) {
  const io::Json summary = summaryOf("dolly", runOf(0.03, {}));
  EXPECT_EQ(summary["cpu_ms"]["mean"], 2.0);
  EXPECT_EQ(summary["cpu_ms"]["worst"], 3.0);
  EXPECT_EQ(summary["features_ms"]["mean"], 1.0);
  EXPECT_EQ(summary["features_ms"]["p99"], 1.5);
  EXPECT_EQ(summary["features_ms"]["worst"], 1.5);
}

TEST(GapReport, TheScaleIsOfGapsThatHaveOne) {
  GapReport report = runOf(0.03, Scale{.error = -0.03, .sigma = 0.02});
  report.add(runOf(0.03, {}));
  for (const io::Json& summary : {summaryOf("dolly", report)["ends"]["scale_percent"],
                                  summaryOf("dolly", report)["into"][0]["scale_percent"]}) {
    EXPECT_NEAR(summary["rms"].get<double>(), 3.0, 1e-12);
    EXPECT_NEAR(summary["worst"].get<double>(), 3.0, 1e-12);
    EXPECT_NEAR(summary["told"].get<double>(), 2.0, 1e-12);
  }
  EXPECT_TRUE(summaryOf("dolly", runOf(0.03, {}))["ends"]["scale_percent"].is_null());
}

TEST(GapReport, TheLongestStretchBeyondThreeSigma) {
  GapReport report = runOf(0.03, {});
  report.beyond_position = {{.begin_s = 1.0, .end_s = 1.1}, {.begin_s = 3.0, .end_s = 3.5}};
  report.beyond = {{.begin_s = 3.0, .end_s = 3.2, .worst_m = 0.04}};
  const io::Json summary = summaryOf("trouble", report);
  EXPECT_NEAR(summary["beyond_3_sigma_position_longest_s"].get<double>(), 0.5, 1e-12);
  EXPECT_NEAR(summary["beyond_3_sigma_longest_s"].get<double>(), 0.2, 1e-12);
  EXPECT_EQ(summary["beyond_position"].size(), 2U);
  EXPECT_NEAR(summary["beyond"][0]["worst_mm"].get<double>(), 40.0, 1e-9);
}

TEST(GapReport, OfNoRunsAtAll) {
  const io::Json summary = summaryOf("dolly", {});
  EXPECT_EQ(summary["frames"], 0);
  EXPECT_EQ(summary["features_ms"]["worst"], 0.0);
  EXPECT_TRUE(summary["into"].empty());
  print(summary);
}

}  // namespace
}  // namespace waymark::bench
