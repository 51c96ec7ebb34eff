#include "slam/camera/lens_model.h"

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::slam {
namespace {

// The largest distance of a ray's two pixels over the image.
double apart_px(const CameraModel& a, const CameraModel& b) {
  double largest = 0.0;
  for (double x = 0.0; x < a.width(); x += 31.0) {
    for (double y = 0.0; y < a.height(); y += 31.0) {
      const auto normalized = a.undistort({x, y});
      if (normalized)
        largest = std::max(largest, (b.distort(*normalized) - Eigen::Vector2d(x, y)).norm());
    }
  }
  return largest;
}

TEST(LensModel, OneLensInBothModels) {
  const CameraModel rational(testing::testCalibration());
  const auto fisheye = inModel(DistortionModel::kEquidistant, rational);
  ASSERT_TRUE(fisheye);
  EXPECT_EQ(fisheye->calibration().model, DistortionModel::kEquidistant);
  EXPECT_LT(apart_px(rational, *fisheye), 0.5) << "it has no tangential coefficients";
  const auto back = inModel(DistortionModel::kRational, *fisheye);
  ASSERT_TRUE(back);
  EXPECT_LT(apart_px(rational, *back), 0.6);
}

TEST(LensModel, AsItIsWhereTheModelIsTheSame) {
  const CameraModel rational(testing::testCalibration());
  EXPECT_EQ(asLens(rational, rational).calibration(), rational.calibration());
  EXPECT_EQ(inModel(DistortionModel::kRational, rational)->calibration(), rational.calibration());
}

TEST(LensModel, WithoutDistortionEachModelIsItsOwn) {
  const CameraModel rational(testing::testCalibration());
  for (const auto model : {DistortionModel::kRational, DistortionModel::kEquidistant}) {
    const Calibration plain = withoutDistortion(model, rational).calibration();
    EXPECT_EQ(plain.model, model);
    EXPECT_EQ(plain.fx, rational.calibration().fx);
    EXPECT_EQ(plain.distortion, decltype(plain.distortion){});
  }
}

}  // namespace
}  // namespace waymark::slam
