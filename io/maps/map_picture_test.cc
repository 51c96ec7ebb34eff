#include "io/maps/map_picture.h"

#include <string>

#include <gtest/gtest.h>

namespace waymark::io {
namespace {

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t found = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) {
    ++found;
  }
  return found;
}

MapPicture sample() {
  MapPicture picture{.title = "a <b> & c", .markers = {}, .estimate = {}, .truth = {}};
  for (int id = 0; id < 3; ++id) {
    MarkerCorners marker{id, 0.2, slam::markerCorners(0.2)};
    for (Eigen::Vector3d& corner : marker.corners) corner.x() += id;
    picture.markers.push_back(marker);
  }
  for (std::int64_t i = 0; i < 10; ++i) {
    const std::int64_t gap_ns = i >= 5 ? 1'000'000'000 : 0;
    picture.estimate.push_back(
        {i * 10'000'000 + gap_ns, {Eigen::Matrix3d::Identity(), {0.1 * i, 0.3, 0.0}}});
  }
  return picture;
}

TEST(MapPicture, ShowsEveryMarkerAndBreaksTheLineAtAGap) {
  const std::string svg = formatMapPicture(sample());
  EXPECT_EQ(count(svg, "<polygon"), 3U);
  EXPECT_EQ(count(svg, "stroke-dasharray"), 1U);
  EXPECT_EQ(count(svg, ">truth<"), 0U);
  EXPECT_NE(svg.find("a &lt;b&gt; &amp; c"), std::string::npos);
  EXPECT_EQ(svg, formatMapPicture(sample()));
}

TEST(MapPicture, ChoosesTheAxesOfLargestExtent) {
  MapPicture picture = sample();
  EXPECT_NE(formatMapPicture(picture).find("x to the right, y down"), std::string::npos);
  picture.z_is_up = true;
  EXPECT_NE(formatMapPicture(picture).find("x to the right, y up"), std::string::npos);
  picture.estimate.back().T_w_c.p.z() = 5.0;
  EXPECT_NE(formatMapPicture(picture).find("x to the right, z up"), std::string::npos);
}

TEST(MapPicture, PhotographsAreNotJoined) {
  MapPicture picture = sample();
  picture.photographs = true;
  const std::string svg = formatMapPicture(picture);
  EXPECT_EQ(count(svg, "<path"), 0U);
  EXPECT_EQ(count(svg, "<circle"), 10U + 1U) << "and one in the legend";
  EXPECT_EQ(count(svg, ">end<"), 0U);
}

TEST(MapPicture, LongTitlesStayOnThePage) {
  MapPicture picture = sample();
  picture.title = std::string(300, 'd') + "/frames.avi, 640x480";
  const std::string svg = formatMapPicture(picture);
  EXPECT_EQ(svg.find(picture.title), std::string::npos);
  EXPECT_NE(svg.find(">..."), std::string::npos);
  EXPECT_NE(svg.find("d/frames.avi, 640x480</text>"), std::string::npos);
}

TEST(MapPicture, OfNothingIsStillAPicture) {
  const std::string svg =
      formatMapPicture({.title = "empty", .markers = {}, .estimate = {}, .truth = {}});
  EXPECT_EQ(count(svg, "nan"), 0U);
  EXPECT_EQ(count(svg, "inf"), 0U);
  EXPECT_EQ(count(svg, "</svg>"), 1U);
}

}  // namespace
}  // namespace waymark::io
