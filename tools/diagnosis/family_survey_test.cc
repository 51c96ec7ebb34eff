#include "tools/diagnosis/family_survey.h"

#include <string>
#include <vector>

#include <gtest/gtest.h>

#include "tools/diagnosis/testing_sheet.h"

namespace waymark::diagnosis {
namespace {

using testing::sheetOf;

const std::vector<int> kIds = {1, 4, 7, 9, 12, 20};

slam::CameraModel camera() { return guessedCamera(640, 480); }

TEST(FamilySurvey, TellsFamiliesApart) {
  for (const char* name : {"ARUCO_MIP_36h12", "APRILTAG_36h11", "APRILTAG_16h5", "APRILTAG_25h9",
                           "ARUCO_ORIGINAL", "6X6_50", "5X5_50", "4X4_50", "7X7_50"}) {
    const std::vector<GreyImage> images(2, sheetOf(name, kIds));
    const auto found = surveyFamilies(images, camera());
    ASSERT_FALSE(found.empty()) << name;
    EXPECT_EQ(found.front().dictionary, name);
    EXPECT_EQ(found.front().markers, 12) << name;
    EXPECT_EQ(found.front().images, 2) << name;
    EXPECT_EQ(found.front().ids, std::set<int>(kIds.begin(), kIds.end())) << name;
  }
}

TEST(FamilySurvey, TheSmallestOfKinThatHasAllIds) {
  const std::vector<GreyImage> images = {sheetOf("5X5_1000", {3, 49, 77, 120})};
  const auto found = surveyFamilies(images, camera());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found.front().dictionary, "5X5_250");
}

TEST(FamilySurvey, SizesAreInPixels) {
  const auto found =
      countFamily("APRILTAG_36h11", std::vector{sheetOf("APRILTAG_36h11", kIds)}, camera());
  EXPECT_NEAR(found.median_side_px, 80.0, 0.5);
}

TEST(FamilySurvey, NothingIsInImagesWithoutMarkers) {
  EXPECT_TRUE(surveyFamilies({}, camera()).empty());
  EXPECT_TRUE(surveyFamilies(std::vector{sheetOf("4X4_50", {})}, camera()).empty());
  EXPECT_EQ(countFamily("4X4_50", std::vector{sheetOf("APRILTAG_36h11", kIds)}, camera()).markers,
            0);
}

TEST(FamilySurvey, ImagesOfAnotherSizeAreLeftOut) {
  const std::vector<GreyImage> images = {sheetOf("5X5_50", kIds, 800, 600)};
  EXPECT_EQ(countFamily("5X5_50", images, camera()).markers, 0);
}

TEST(FamilySurvey, MirrorImagesAndNegatives) {
  const GreyImage good = sheetOf("APRILTAG_36h11", kIds);
  const std::vector<GreyImage> mirror = {mirrored(good.view())};
  EXPECT_TRUE(surveyFamilies(mirror, camera()).empty());
  const OddImages odd = lookForOddImages(mirror, camera());
  ASSERT_TRUE(odd.mirrored.has_value());
  EXPECT_EQ(odd.mirrored->dictionary, "APRILTAG_36h11");
  EXPECT_EQ(odd.mirrored->markers, 6);
  EXPECT_FALSE(odd.inverted.has_value());

  const OddImages negative = lookForOddImages(std::vector{inverted(good.view())}, camera());
  EXPECT_FALSE(negative.mirrored.has_value());
  ASSERT_TRUE(negative.inverted.has_value());
  EXPECT_EQ(negative.inverted->dictionary, "APRILTAG_36h11");
}

}  // namespace
}  // namespace waymark::diagnosis
