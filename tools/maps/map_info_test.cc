#include "tools/maps/map_info.h"

#include <string>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"

namespace waymark::tools {
namespace {

TEST(MapInfo, OfASmallMap) {
  io::MapFile file;
  file.camera = slam::testing::testCalibration();
  file.map.dictionary = "4X4_50";
  const slam::CameraModel camera(*file.camera);
  std::mt19937 rng(1);
  slam::Keyframe keyframe;
  keyframe.T_w_c = slam::testing::lookAt({0, 0, 0}, {0, 2, 0});
  for (const int id : {3, 7}) {
    const slam::Transform T_w_m =
        slam::testing::markerFacing({0.5 * (id - 5), 2, 0}, {0.5 * (id - 5), 0, 0});
    file.map.addMarker(id, 0.2);
    file.map.place(id, T_w_m);
    keyframe.detections.push_back(
        *slam::testing::observe(camera, keyframe.T_w_c, id, T_w_m, 0.2, 0.0, &rng));
  }
  slam::Matrix6d covariance = slam::Matrix6d::Zero();
  covariance.diagonal() << 1e-6, 4e-6, 1e-6, 1e-6, 1e-6, 9e-6;
  file.map.setWorldCovariance(7, covariance);
  file.map.addMarker(9, 0.1);
  file.map.ban(9);
  // One marker's pixels are off by (3, 4), the other's are exact.
  keyframe.detections.change([](auto* detections) {
    for (Eigen::Vector2d& pixel : (*detections)[1].pixels) pixel += Eigen::Vector2d(3, 4);
  });
  slam::PicturePrint print;
  print.name = "poster";
  print.width_m = 0.3;
  print.height_m = 0.4;
  const int poster = file.map.addPicture(print).id;
  file.map.place(poster, slam::testing::markerFacing({0, 2, 1}, {0, 0, 1}));
  keyframe.links = {{poster, {}, slam::Matrix6d::Identity()}};
  file.map.addKeyframe(keyframe);

  const auto fits = reprojectionFitByMarker(file);
  EXPECT_NEAR(fits.at(3).rms_px, 0.0, 1e-6);
  EXPECT_NEAR(fits.at(7).rms_px, 5.0, 1e-6);
  EXPECT_EQ(reprojectionFit(file).corners, 8U);
  EXPECT_NEAR(reprojectionFit(file).rms_px, std::sqrt(12.5), 1e-6);
  const std::string text = mapInfo(file, /*with_markers=*/true);
  for (const char* line :
       {"dictionary  4X4_50\n", "markers     3: 2 mapped, 1 refused\n",
        "sizes       1 of 0.1 m, 2 of 0.2 m\n",
        "extent      2.200 0.000 0.200 m, from -1.100 2.000 -0.100 to 1.100 2.000 0.100\n",
        "keyframes   1, 2 views of markers\n", "fit         3.536 px rms over 8 corners\n",
        "camera      640x480, fx 520.00 fy 521.00 cx 318.00 cy 242.00\n", "checksum    right\n",
        "  7  mapped  0.2 m  p 1.000 2.000 0.000  q ",
        "  sigma 2.00 mm 0.172 deg  1 views  5.000 px\n",
        "sigma       of 1 markers in the world: median 2.00 mm, worst 2.00 mm\n",
        "  9  refused  0.1 m  0 views\n", "natural     1: 1 mapped\n",
        "  poster  mapped  0.3 x 0.4 m  p 0.000 2.000 1.000  q "}) {
    EXPECT_NE(text.find(line), std::string::npos) << text << "\nhas not: " << line;
  }
  EXPECT_EQ(mapInfo(file, false).find("  7  mapped"), std::string::npos);
}

TEST(MapInfo, EachOfSeveralPiecesHasItsHeading) {
  io::MapFile file;
  file.map.dictionary = "4X4_50";
  file.map.addMarker(3, 0.2);
  const std::string first = mapInfo(file, true);
  EXPECT_EQ(first.find("piece"), std::string::npos);
  io::MapFile other;
  other.map.dictionary = "4X4_50";
  other.map.addMarker(4, 0.1);
  const std::string second = mapInfo(other, true);
  file.other_pieces.push_back(other.map);
  file.other_pieces.front().piece = 6;
  EXPECT_EQ(mapInfo(file, true),
            "piece 0, a world of its own\n" + first + "\npiece 6, a world of its own\n" + second);
}

TEST(MapInfo, OfAnEmptyMap) {
  io::MapFile file;
  file.map.dictionary = "4X4_50";
  file.has_checksum = false;
  EXPECT_EQ(mapInfo(file, true),
            "dictionary  4X4_50\nmarkers     0: none\nkeyframes   0\ncamera      none\n"
            "checksum    none\n");
}

}  // namespace
}  // namespace waymark::tools
