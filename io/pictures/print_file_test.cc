#include "io/pictures/print_file.h"

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

std::vector<slam::PicturePrint> twoPrints() {
  slam::PicturePrint surveyed;
  surveyed.name = "exit \"sign\"";
  surveyed.width_m = 0.3;
  surveyed.height_m = 0.1;
  surveyed.T_w_m = slam::Transform{}.retract(
      (slam::Vector6d() << 1.0, -2.0, 1.0 / 3.0, 0.3, -0.7, 1.1).finished());
  surveyed.points_m = {{0.1, -0.04}, {-1.0 / 7.0, 0.02}};
  slam::PicturePrint poster;
  poster.name = "poster";
  poster.width_m = 0.59;
  poster.height_m = 0.84;
  return {surveyed, poster};
}

TEST(PrintFile, GivesBackWhatWasWritten) {
  const std::string text = formatPrints(twoPrints());
  const auto read = parsePrints(text, "prints");
  ASSERT_TRUE(read.ok()) << read.error().message;
  ASSERT_EQ(read->size(), 2U);
  const slam::PicturePrint& first = read->front();
  EXPECT_EQ(first.name, "exit \"sign\"");
  EXPECT_EQ(first.width_m, 0.3);
  EXPECT_EQ(first.height_m, 0.1);
  EXPECT_EQ(first.sigma_m, slam::PicturePrint{}.sigma_m);
  EXPECT_EQ(first.sigma_rad, slam::PicturePrint{}.sigma_rad);
  EXPECT_EQ(first.points_m, twoPrints().front().points_m) << "to the last bit";
  ASSERT_TRUE(first.T_w_m);
  EXPECT_EQ(first.T_w_m->p, twoPrints().front().T_w_m->p);
  EXPECT_LT(slam::rotationDistance(first.T_w_m->R, twoPrints().front().T_w_m->R), 1e-7);
  EXPECT_FALSE(read->back().T_w_m);
  EXPECT_TRUE(read->back().points_m.empty());
}

TEST(PrintFile, WritingItAgainChangesNothing) {
  const std::string text = formatPrints(twoPrints());
  EXPECT_EQ(formatPrints(*parsePrints(text, "prints")), text);
}

TEST(PrintFile, SaysWhatIsWrongAndWhere) {
  const auto errorOf = [](std::string text, const std::string& from, const std::string& to) {
    text.replace(text.find(from), from.size(), to);
    const auto read = parsePrints(text, "prints");
    return read ? std::string() : read.error().message;
  };
  const std::string text = formatPrints(twoPrints());
  EXPECT_EQ(errorOf(text, "waymark-prints", "prints"),
            "prints: format: is 'prints', not 'waymark-prints'");
  EXPECT_NE(errorOf(text, "\"width\":0.3", "\"width\":-1").find("prints: markers[0].width: "),
            std::string::npos);
  EXPECT_NE(errorOf(text, "\"width\":0.59", "\"wide\":0.59").find("prints: markers[1].width: "),
            std::string::npos);
}

}  // namespace
}  // namespace waymark::io
