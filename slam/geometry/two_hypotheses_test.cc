#include "slam/geometry/two_hypotheses.h"

#include <optional>
#include <vector>

#include <gtest/gtest.h>

namespace waymark::slam {
namespace {

Transform turned(double rad) { return {expSo3({0.0, 0.0, rad}), Eigen::Vector3d::Zero()}; }

struct Hypothesis {
  double rad = 0.0;
};

// The rival of the pose that is not turned, from 0.1 rad on, among candidates that refinement turns
// by `by`; refinement comes to nothing for what is turned by more than 2 rad.
std::optional<double> rival(const std::vector<Hypothesis>& candidates, double by,
                            std::vector<double>* refined = nullptr) {
  const auto other = otherHypothesis(
      candidates, turned(0.0), 0.1,
      [&](const Hypothesis& candidate) -> std::optional<Hypothesis> {
        if (refined != nullptr) refined->push_back(candidate.rad);
        if (candidate.rad > 2.0) return std::nullopt;
        return Hypothesis{candidate.rad + by};
      },
      [](const Hypothesis& hypothesis) { return turned(hypothesis.rad); });
  return other ? std::optional(other->rad) : std::nullopt;
}

TEST(TwoHypotheses, AnotherPoseIsTurned) {
  EXPECT_FALSE(isAnotherPose(turned(0.3), turned(0.35), 0.1));
  EXPECT_TRUE(isAnotherPose(turned(0.3), turned(0.45), 0.1));
  Transform elsewhere = turned(0.3);
  elsewhere.p.x() = 5.0;
  EXPECT_FALSE(isAnotherPose(turned(0.3), elsewhere, 0.1));
}

TEST(TwoHypotheses, TheFirstThatStaysAnother) {
  EXPECT_EQ(rival({{0.0}, {0.05}, {0.5}, {0.9}}, 0.0), 0.5);
  EXPECT_EQ(rival({{0.0}, {0.9}, {0.5}}, 0.0), 0.9) << "they come best first";
  EXPECT_EQ(rival({{0.0}, {0.25}, {0.5}}, -0.2), 0.3) << "0.25 falls to the best one";
  EXPECT_EQ(rival({{0.0}, {2.5}, {0.5}}, 0.0), 0.5) << "2.5 comes to nothing";
}

TEST(TwoHypotheses, MayBeOne) {
  EXPECT_EQ(rival({}, 0.0), std::nullopt);
  EXPECT_EQ(rival({{0.0}, {0.05}, {-0.09}}, 0.5), std::nullopt) << "none was another to begin with";
  EXPECT_EQ(rival({{0.0}, {0.25}, {0.28}}, -0.2), std::nullopt);
}

TEST(TwoHypotheses, RefinesNoMoreThanItMust) {
  std::vector<double> refined;
  EXPECT_EQ(rival({{0.0}, {0.05}, {2.5}, {0.5}, {0.9}}, 0.0, &refined), 0.5);
  EXPECT_EQ(refined, (std::vector<double>{2.5, 0.5}));
}

}  // namespace
}  // namespace waymark::slam
