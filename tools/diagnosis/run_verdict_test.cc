#include "tools/diagnosis/run_verdict.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tools/diagnosis/testing_sheet.h"

namespace waymark::diagnosis {
namespace {

using Grade = Verdict::Grade;
using testing::sheetOf;

// A run as it should be.
RunFacts goodRun() {
  return {.dictionary = "ARUCO_MIP_36h12",
          .marker_size_m = 0.165,
          .focal_px = 600.0,
          .frames = 200,
          .localized = 199,
          .frames_with_markers = 200,
          .markers_seen = 1000,
          .seen_by_id = {{1, 500}, {2, 500}},
          .median_side_px = 40.0,
          .rejected_markers = 3,
          .rms_px = 0.08,
          .quads = 5000,
          .reasons = {{"no marker in view", 1}}};
}

// Nothing was found in it.
RunFacts emptyRun() {
  RunFacts facts = goodRun();
  facts.localized = facts.frames_with_markers = facts.markers_seen = 0;
  facts.seen_by_id.clear();
  facts.median_side_px = facts.rms_px = 0.0;
  facts.reasons = {{"no marker in view", 200}};
  return facts;
}

ImageFacts imagesOf(const std::vector<GreyImage>& images,
                    const std::string& dictionary = "ARUCO_MIP_36h12") {
  return lookAt(images, dictionary, guessedCamera(images.front().width, images.front().height));
}

// The first advice of a run contains it.
void expectAdvice(const RunFacts& facts, Grade grade, const std::string& what) {
  const Verdict verdict = judge(facts);
  EXPECT_EQ(verdict.grade, grade) << formatVerdict(verdict);
  ASSERT_FALSE(verdict.advice.empty()) << what;
  EXPECT_NE(verdict.advice.front().find(what), std::string::npos) << formatVerdict(verdict);
}

TEST(RunVerdict, AGoodRunIsGood) {
  const Verdict verdict = judge(goodRun());
  EXPECT_EQ(verdict.grade, Grade::kGood);
  EXPECT_EQ(formatVerdict(verdict),
            "verdict: good: a pose in 99.5 % of 200 frames, reprojection error 0.08 px\n");
  EXPECT_FALSE(wantsImages(goodRun()));
}

TEST(RunVerdict, AnotherFamilyIsNamed) {
  RunFacts facts = emptyRun();
  EXPECT_TRUE(wantsImages(facts));
  facts.images = imagesOf({sheetOf("APRILTAG_36h11", {1, 2, 3, 4, 5, 6, 7, 8})});
  expectAdvice(facts, Grade::kNone,
               "no marker of ARUCO_MIP_36h12 in 200 frames; in 1 image of them 8 squares decode as "
               "APRILTAG_36h11 (ids 1, 2, 3, 4, 5, 6 and 2 more): --dictionary APRILTAG_36h11");
}

// As on photographs of a room: one square in two hundred frames happened to be a code.
TEST(RunVerdict, APoseFromOneFalseMarkerIsNone) {
  RunFacts facts = emptyRun();
  facts.localized = facts.frames_with_markers = facts.markers_seen = 1;
  facts.median_side_px = 30.0;
  facts.seen_by_id = {{17, 1}};
  facts.images = imagesOf({sheetOf("APRILTAG_36h11", {1, 2, 3, 4, 5, 6, 7, 8})});
  expectAdvice(facts, Grade::kNone, "1 marker of ARUCO_MIP_36h12 in 200 frames; in 1 image");
  EXPECT_EQ(judge(facts).text, "no pose that can be believed (a pose in 0.5 % of 200 frames)");
}

TEST(RunVerdict, AFewMarkersOfAnotherFamilyDoNotMatter) {
  RunFacts facts = goodRun();
  facts.localized = 60;
  facts.frames_with_markers = 65;
  facts.images = imagesOf({sheetOf("ARUCO_MIP_36h12", {1, 2, 3, 4, 5, 6, 7, 8})});
  facts.images->families.push_back({.dictionary = "4X4_50", .markers = 3, .images = 1});
  const Verdict verdict = judge(facts);
  EXPECT_EQ(verdict.grade, Grade::kDoubtful);
  ASSERT_EQ(verdict.advice.size(), 1U) << formatVerdict(verdict);
  EXPECT_EQ(verdict.advice.front(), "no marker is in view in 68 % of the frames");
}

TEST(RunVerdict, ALensThatDoesNotFit) {
  RunFacts facts = goodRun();
  facts.rms_px = 1.6;
  expectAdvice(facts, Grade::kDoubtful, "the reprojection error is 1.60 px where 0.1 is usual");
  facts.own_corners = false;
  EXPECT_EQ(judge(facts).grade, Grade::kGood) << "another detector's corners are not as good";
  facts.rms_px = 3.0;
  expectAdvice(facts, Grade::kDoubtful, "the reprojection error is 3.00 px");
  facts.own_corners = true;
  facts.rms_px = 0.3;
  facts.rejected_markers = 400;
  expectAdvice(facts, Grade::kDoubtful, "40 % of the markers seen contradict the others");
}

TEST(RunVerdict, ALensThatIsNotLearnedYet) {
  RunFacts facts = goodRun();
  facts.lens_given = false;
  EXPECT_EQ(judge(facts).grade, Grade::kGood);
  facts.lens_open_share = 0.0068;
  expectAdvice(facts, Grade::kDoubtful,
               "the lens is not learned yet, its focal length known to 0.68 %: come nearer");
  facts.lens_open_share = 0.0;
  facts.rms_px = 1.6;
  expectAdvice(facts, Grade::kDoubtful, "the lens may be learned wrongly");
}

TEST(RunVerdict, SizesThatAreNotMetres) {
  RunFacts facts = goodRun();
  facts.marker_size_m = 50.0;
  expectAdvice(facts, Grade::kDoubtful, "markers of 50.00 m, which are then 750 m away");
}

TEST(RunVerdict, SmallMarkers) {
  RunFacts facts = goodRun();
  facts.median_side_px = 9.0;
  expectAdvice(facts, Grade::kDoubtful, "the markers are small in the image (9 pixels a side)");
}

TEST(RunVerdict, NoSquaresAtAll) {
  RunFacts facts = emptyRun();
  facts.quads = 0;
  facts.images = imagesOf({sheetOf("4X4_50", {})});
  expectAdvice(facts, Grade::kNone, "there is no dark square in any frame");
  facts.quads = 70;
  expectAdvice(facts, Grade::kNone, "squares were found (70 in all frames)");
}

TEST(RunVerdict, MirroredAndInverted) {
  const GreyImage good = sheetOf("ARUCO_MIP_36h12", {1, 2, 3, 4, 5, 6});
  RunFacts facts = emptyRun();
  facts.images = imagesOf({mirrored(good.view())});
  expectAdvice(facts, Grade::kNone, "the images are mirrored: turned left to right, 6 squares");
  facts.images = imagesOf({inverted(good.view())});
  expectAdvice(facts, Grade::kNone, "the markers are white on black");
}

TEST(RunVerdict, BlurAndDarknessAreTold) {
  const GreyImage blur = testing::blurred(sheetOf("ARUCO_MIP_36h12", {1, 2, 3, 4}), 12);
  RunFacts facts = emptyRun();
  facts.images = imagesOf({blur});
  EXPECT_NE(formatVerdict(judge(facts)).find("nothing in the images is sharp"), std::string::npos);
  GreyImage dark = sheetOf("ARUCO_MIP_36h12", {});
  for (auto& pixel : dark.pixels) pixel = 4;
  facts.images = imagesOf({dark});
  EXPECT_NE(formatVerdict(judge(facts)).find("the images are dark"), std::string::npos);
}

TEST(RunVerdict, MarkersWithoutAPoseSayWhy) {
  RunFacts facts = goodRun();
  facts.localized = 0;
  facts.rms_px = 0.0;
  facts.seen_by_id = {{5, 200}};
  facts.reasons = {{"no marker in view", 10}, {"all markers in view are ambiguous", 190}};
  expectAdvice(facts, Grade::kNone, "most often: all markers in view are ambiguous (190 frames)");
  EXPECT_NE(judge(facts).advice.at(1).find("one marker only was seen, id 5, 200 times"),
            std::string::npos);
}

TEST(RunVerdict, ARunWithoutImagesOrFramesHasAVerdict) {
  expectAdvice(emptyRun(), Grade::kNone, "no frame has a marker");
  EXPECT_EQ(judge({}).grade, Grade::kNone);
}

}  // namespace
}  // namespace waymark::diagnosis
