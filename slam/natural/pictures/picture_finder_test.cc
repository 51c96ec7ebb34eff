#include "slam/natural/pictures/picture_finder.h"

#include <random>
#include <vector>

#include <gtest/gtest.h>

#include "slam/testing/seen_picture.h"
#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

constexpr double kWidth_m = 0.3;
constexpr double kHeight_m = 0.225;

std::vector<NaturalMarker> posters(unsigned count) {
  std::vector<NaturalMarker> markers;
  for (unsigned i = 0; i < count; ++i) {
    const cv::Mat image = testing::poster(100 + i);
    auto marker = NaturalMarker::create(testing::viewOf(image), kWidth_m, 0.0);
    EXPECT_TRUE(marker) << marker.error().message;
    if (marker) markers.push_back(std::move(*marker));
  }
  return markers;
}

class PictureFinderTest : public ::testing::Test {
 protected:
  [[nodiscard]] cv::Mat seen(unsigned poster, const Transform& T_c_p, unsigned seed = 1) const {
    return testing::seenPicture(scene_, testing::poster(100 + poster), kWidth_m, kHeight_m, T_c_p,
                                seed);
  }

  testing::PictureScene scene_{.camera = CameraModel(testing::testCalibration())};
};

TEST_F(PictureFinderTest, FindsThePictureAndItsPose) {
  const std::vector<NaturalMarker> markers = posters(5);
  PictureFinder finder(markers);
  for (const double distance_m : {0.4, 0.9, 1.6}) {
    const Transform truth = testing::pictureAt(distance_m, 0.5, 0.7, 0.3);
    const cv::Mat image = seen(3, truth);
    const PictureSearch search = finder.find(testing::viewOf(image), scene_.camera);
    ASSERT_EQ(search.found.size(), 1U) << distance_m;
    EXPECT_EQ(search.found[0].picture, 3);
    const Vector6d error = truth.localCoordinates(search.found[0].alignment.T_c_p);
    EXPECT_LT(error.head<2>().norm(), 0.0005 * distance_m) << distance_m;
    EXPECT_LT(std::abs(error.z()), 0.005 * distance_m) << distance_m;
    EXPECT_LT(error.tail<3>().norm(), 0.03) << distance_m;
  }
}

TEST_F(PictureFinderTest, ErrorsAreAsLargeAsTheCovarianceSays) {
  const std::vector<NaturalMarker> markers = posters(1);
  PictureFinderOptions options;
  options.alignment.systematic_sigma_px = 0.005;  // what is rendered has no bent paper
  PictureFinder finder(markers, options);
  std::mt19937 rng(3);
  const auto uniform = [&rng](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(rng);
  };
  double sum = 0.0;
  int count = 0;
  constexpr int kRuns = 40;
  for (int i = 0; i < kRuns; ++i) {
    const Transform truth = testing::pictureAt(uniform(0.4, 1.5), uniform(0.2, 0.9),
                                               uniform(-3.0, 3.0), uniform(-3.0, 3.0));
    const cv::Mat image = seen(0, truth, static_cast<unsigned>(i));
    const PictureSearch search = finder.find(testing::viewOf(image), scene_.camera);
    if (search.found.empty()) continue;
    const PictureAlignment& found = search.found[0].alignment;
    const Vector6d error = found.T_c_p.localCoordinates(truth);
    const double nees = error.dot(found.covariance.ldlt().solve(error));
    std::printf("nees %.2f dep %.2f noise %.2f blur %.2f px %d corr %.3f z %.2f\n", nees,
                found.dependence, found.noise, found.blur_px, found.pixels, found.correlation,
                truth.p.z());
    sum += nees;
    ++count;
  }
  EXPECT_GE(count, 36);
  const double mean = sum / count;
  // 6 degrees of freedom; the mean over 40 runs has a sigma of 0.55.
  EXPECT_GT(mean, 2.0);
  EXPECT_LT(mean, 7.5);
}

}  // namespace
}  // namespace waymark::slam
