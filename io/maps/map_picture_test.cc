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
  MapPicture picture{.title = "a <b> & c", .pieces = {MapDrawing{}}};
  MapDrawing& drawing = picture.pieces.front();
  for (int id = 0; id < 3; ++id) {
    MarkerCorners marker{id, 0.2, slam::markerCorners(0.2)};
    for (Eigen::Vector3d& corner : marker.corners) corner.x() += id;
    drawing.markers.push_back(marker);
  }
  for (std::int64_t i = 0; i < 10; ++i) {
    const std::int64_t gap_ns = i >= 5 ? 1'000'000'000 : 0;
    drawing.estimate.push_back(
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
  picture.pieces[0].estimate.back().T_w_c.p.z() = 5.0;
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

TEST(MapPicture, NaturalMarkersHaveTheirNames) {
  MapPicture picture = sample();
  MapDrawing& drawing = picture.pieces.front();
  const slam::Transform above{Eigen::Matrix3d::Identity(), {1.0, -1.0, 0.0}};
  drawing.natural.push_back({"the <poster>", rectangleCorners(above, 0.6, 0.4)});
  const std::string svg = formatMapPicture(picture);
  EXPECT_EQ(count(svg, "<polygon"), 4U);
  EXPECT_EQ(count(svg, ">the &lt;poster&gt;<"), 1U);
  EXPECT_EQ(count(svg, "3 markers, 1 natural ones (violet), 10 poses"), 1U);
  // Where it is too small for its name, that is beside it.
  drawing.natural.push_back(
      {"a door with a name that nobody can read", rectangleCorners(above, 0.01, 0.02)});
  EXPECT_EQ(count(formatMapPicture(picture), ">a door with a name th...<"), 1U);
}

TEST(MapPicture, EachPieceIsADrawingOfItsOwn) {
  MapPicture picture = sample();
  const std::string one = formatMapPicture(picture);
  EXPECT_EQ(count(one, ">piece "), 0U);
  picture.pieces.push_back(picture.pieces.front());
  picture.pieces.back().piece = 4;
  picture.pieces.back().markers.pop_back();
  const std::string svg = formatMapPicture(picture);
  EXPECT_EQ(count(svg, "<polygon"), 5U);
  EXPECT_EQ(count(svg, ">piece 0<"), 1U);
  EXPECT_EQ(count(svg, ">piece 4<"), 1U);
  EXPECT_EQ(count(svg, " cm<") + count(svg, " m<"), 2U) << "a scale bar each";
  EXPECT_EQ(count(svg, "a &lt;b&gt; &amp; c"), 1U) << "one title";
  EXPECT_EQ(count(svg, "<svg"), 1U);
  EXPECT_EQ(count(svg, "<g "), count(svg, "</g>"));
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
  const std::string svg = formatMapPicture({.title = "empty", .pieces = {MapDrawing{}}});
  EXPECT_EQ(count(svg, "nan"), 0U);
  EXPECT_EQ(count(svg, "inf"), 0U);
  EXPECT_EQ(count(svg, "</svg>"), 1U);
}

}  // namespace
}  // namespace waymark::io
