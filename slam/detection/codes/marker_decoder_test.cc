#include "slam/detection/codes/marker_decoder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <utility>
#include <vector>

#include <gtest/gtest.h>

#include "slam/geometry/homography.h"
#include "slam/testing/picture.h"

namespace waymark::slam {
namespace {

using Quad = std::array<Eigen::Vector2d, 4>;
using Cell = std::pair<int, int>;  // row, column; from the border's top-left

constexpr int kDark = 30;    // grey levels
constexpr int kLight = 210;  // also of the wall
constexpr Calibration kPinhole{
    .width = 640, .height = 480, .fx = 520.0, .fy = 520.0, .cx = 319.5, .cy = 239.5};

// Markers painted as a camera sees them, read with their true corners.
class MarkerDecoderTest : public ::testing::Test {
 protected:
  // The corners in normalized coordinates of a print whose corners are there in the image, pixels.
  [[nodiscard]] Quad normalized(const Quad& pixels) const {
    Quad corners;
    for (std::size_t k = 0; k < 4; ++k) corners[k] = *camera_.undistort(pixels[k]);
    return corners;
  }
  // Upright; left and top are the outer edges of the border, pixels.
  [[nodiscard]] Quad square(double left, double top, double side) const {
    return normalized(
        {{{left, top}, {left + side, top}, {left + side, top + side}, {left, top + side}}});
  }
  // As square(), of cells of so many pixels, with its outer edges between pixels.
  [[nodiscard]] Quad squareOfCells(double cell_px) const {
    return square(99.5, 79.5, cell_px * dictionary_.cells());
  }

  // `inverted`: cells that show the opposite of what the code says.
  void paint(int id, const Quad& corners, const std::set<Cell>& inverted = {}) {
    const Eigen::Matrix3d H_inverse = homographyFromUnitSquare(corners)->inverse();
    const int cells = dictionary_.cells();
    for (int y = 0; y < picture_.height(); ++y) {
      for (int x = 0; x < picture_.width(); ++x) {
        const auto ray = camera_.undistort({x, y});
        if (!ray) continue;
        const Eigen::Vector2d unit = cells * applyHomography(H_inverse, *ray);
        const int column = static_cast<int>(std::floor(unit.x()));
        const int row = static_cast<int>(std::floor(unit.y()));
        if (row < 0 || column < 0 || row >= cells || column >= cells) continue;
        const bool white = dictionary_.white(id, row, column) != inverted.contains({row, column});
        picture_.at(x, y) = static_cast<std::uint8_t>(white ? light_ : dark_);
      }
    }
  }
  [[nodiscard]] QuadReading read(const Quad& corners, const MarkerDecoderOptions& options = {}) {
    MarkerDecoder decoder(camera_, dictionary_, options);
    return decoder.read(picture_.view(), corners);
  }
  void expectMarker(int id, int hamming, const QuadReading& reading) {
    ASSERT_EQ(reading.content, QuadContent::kMarker);
    EXPECT_EQ(reading.match.id, id);
    EXPECT_EQ(reading.match.hamming, hamming);
    EXPECT_EQ(reading.match.rotation, 0);
  }
  // The first `count` cells of the border, around it.
  [[nodiscard]] std::set<Cell> borderCells(int count) const {
    const int last = dictionary_.cells() - 1;
    std::vector<Cell> around;
    for (int i = 0; i < last; ++i) {
      around.insert(around.end(), {{0, i}, {i, last}, {last, i + 1}, {i + 1, 0}});
    }
    return {around.begin(), around.begin() + count};
  }

  CameraModel camera_{kPinhole};
  Dictionary dictionary_ = *Dictionary::byName("ARUCO_MIP_36h12");  // 28 cells of border
  int dark_ = kDark;
  int light_ = kLight;
  testing::Picture picture_{kPinhole.width, kPinhole.height, kLight};
};

TEST_F(MarkerDecoderTest, ReadsSmallAndLargeCells) {
  for (const double cell_px : {3.0, 4.0, 6.0, 11.0, 40.0}) {
    picture_ = testing::Picture(kPinhole.width, kPinhole.height, kLight);
    paint(17, squareOfCells(cell_px));
    SCOPED_TRACE(cell_px);
    expectMarker(17, 0, read(squareOfCells(cell_px)));
  }
}

TEST_F(MarkerDecoderTest, TheRotationSaysWhichCornerWasFirst) {
  const Quad corners = squareOfCells(6.0);
  paint(42, corners);
  for (int first = 0; first < 4; ++first) {
    Quad turned = corners;
    std::ranges::rotate(turned, turned.begin() + first);
    const QuadReading reading = read(turned);
    ASSERT_EQ(reading.content, QuadContent::kMarker) << first;
    EXPECT_EQ(reading.match.id, 42);
    EXPECT_EQ((4 - reading.match.rotation) % 4, first);
  }
}

TEST_F(MarkerDecoderTest, ReadsWhatIsSeenAslant) {
  const Quad corners =
      normalized({{{120.0, 90.0}, {260.0, 130.0}, {250.0, 260.0}, {110.0, 330.0}}});
  paint(5, corners);
  expectMarker(5, 0, read(corners));
}

TEST_F(MarkerDecoderTest, CellsAreWhereTheLensPutsThem) {
  Calibration fisheye = kPinhole;
  fisheye.model = DistortionModel::kEquidistant;
  fisheye.fx = fisheye.fy = 250.0;
  camera_ = CameraModel(fisheye);
  const Quad pixels = {{{130.0, 70.0}, {510.0, 60.0}, {520.0, 410.0}, {140.0, 400.0}}};
  const Quad corners = normalized(pixels);
  paint(99, corners);
  expectMarker(99, 0, read(corners));
  // With the same corners, but straight lines between them, many cells are missed.
  camera_ = CameraModel(kPinhole);
  const QuadReading straight = read(normalized(pixels));
  EXPECT_TRUE(straight.content != QuadContent::kMarker || straight.match.hamming > 0);
}

TEST_F(MarkerDecoderTest, WrongBitsAreCountedAsFarAsTheyAreAllowed) {
  const Quad corners = squareOfCells(6.0);
  std::set<Cell> inverted;
  for (int wrong = 1; wrong <= 3; ++wrong) {
    inverted.insert({wrong, 2 * wrong});
    picture_ = testing::Picture(kPinhole.width, kPinhole.height, kLight);
    paint(3, corners, inverted);
    const QuadReading reading = read(corners);
    if (wrong <= 2) {
      expectMarker(3, wrong, reading);
    } else {
      EXPECT_EQ(reading.content, QuadContent::kNoCode);
    }
  }
  EXPECT_EQ(read(corners, {.max_wrong_bits = 3}).content, QuadContent::kMarker);
}

TEST_F(MarkerDecoderTest, NoMoreBitsMayBeWrongThanTheDictionaryCanCorrect) {
  dictionary_ = *Dictionary::byName("4X4_1000");
  ASSERT_LE(dictionary_.minDistance(), 2);
  const Quad corners = squareOfCells(8.0);
  paint(11, corners);
  expectMarker(11, 0, read(corners));
  // Any wrong bit that does not make another marker of it.
  bool rejected = false;
  for (int column = 1; column <= dictionary_.side() && !rejected; ++column) {
    picture_ = testing::Picture(kPinhole.width, kPinhole.height, kLight);
    paint(11, corners, {{2, column}});
    const QuadReading reading = read(corners);
    EXPECT_TRUE(reading.content == QuadContent::kNoCode || reading.match.hamming == 0);
    rejected = reading.content == QuadContent::kNoCode;
  }
  EXPECT_TRUE(rejected);
}

TEST_F(MarkerDecoderTest, OtherDictionariesCodesAreNone) {
  const Quad corners = squareOfCells(6.0);
  paint(3, corners);
  dictionary_ = *Dictionary::byName("APRILTAG_36h11");
  EXPECT_EQ(read(corners).content, QuadContent::kNoCode);
}

// A tenth of the border may be light in a marker, a third in what may yet be one.
TEST_F(MarkerDecoderTest, TheBorderMayBeDirtyInFewPlaces) {
  const Quad corners = squareOfCells(6.0);
  const auto content_with = [&](int light_cells) {
    picture_ = testing::Picture(kPinhole.width, kPinhole.height, kLight);
    paint(3, corners, borderCells(light_cells));
    return read(corners).content;
  };
  EXPECT_EQ(content_with(2), QuadContent::kMarker);
  EXPECT_EQ(content_with(3), QuadContent::kNoCode);
  EXPECT_EQ(content_with(9), QuadContent::kNoCode);
  EXPECT_EQ(content_with(10), QuadContent::kNothing);
}

TEST_F(MarkerDecoderTest, TheBorderStandsOutFromWhatIsAround) {
  const Quad corners = squareOfCells(6.0);
  const auto content_of = [&](int dark, int light) {
    dark_ = dark;
    light_ = light;
    picture_ = testing::Picture(kPinhole.width, kPinhole.height, static_cast<std::uint8_t>(light));
    paint(3, corners);
    return read(corners).content;
  };
  EXPECT_EQ(content_of(100, 111), QuadContent::kMarker);
  EXPECT_EQ(content_of(100, 109), QuadContent::kNothing);
  EXPECT_EQ(content_of(200, 50), QuadContent::kNothing) << "the wrong way round";
  EXPECT_EQ(content_of(100, 100), QuadContent::kNothing);
}

TEST_F(MarkerDecoderTest, ItsSurroundingsMayBeOutsideTheImageButNotTheMarker) {
  for (const double cell_px : {4.0, 8.0}) {
    const double side = cell_px * dictionary_.cells();
    const Quad top_left = square(-0.5, -0.5, side);
    const Quad bottom_right =
        square(kPinhole.width - 0.5 - side, kPinhole.height - 0.5 - side, side);
    paint(3, top_left);
    paint(4, bottom_right);
    expectMarker(3, 0, read(top_left));
    expectMarker(4, 0, read(bottom_right));

    const Quad cut_off = square(-0.5 - cell_px, 200.0, side);
    paint(5, cut_off);
    EXPECT_EQ(read(cut_off).content, QuadContent::kNothing) << "a column of its border is missing";
  }
  EXPECT_EQ(read(square(-1000.0, -1000.0, 64.0)).content, QuadContent::kNothing);
}

TEST_F(MarkerDecoderTest, DegenerateQuadsAreNothing) {
  paint(3, squareOfCells(6.0));
  const Eigen::Vector2d a(-0.3, -0.2);
  const Eigen::Vector2d b(0.1, 0.1);
  EXPECT_EQ(read({a, a, a, a}).content, QuadContent::kNothing);
  EXPECT_EQ(read({a, b, b, a}).content, QuadContent::kNothing);
  EXPECT_EQ(read({a, 0.5 * (a + b), b, 0.3 * a + 0.7 * b}).content, QuadContent::kNothing);
}

TEST_F(MarkerDecoderTest, ADecoderKeepsNothingOfTheQuadBefore) {
  const Quad large = squareOfCells(20.0);
  const Quad small = square(400.0, 300.0, 4.0 * dictionary_.cells());
  paint(1, large);
  paint(2, small);
  MarkerDecoder decoder(camera_, dictionary_);
  for (int i = 0; i < 2; ++i) {
    expectMarker(1, 0, decoder.read(picture_.view(), large));
    expectMarker(2, 0, decoder.read(picture_.view(), small));
    EXPECT_EQ(decoder.read(picture_.view(), square(450.0, 20.0, 100.0)).content,
              QuadContent::kNothing);
  }
}

}  // namespace
}  // namespace waymark::slam
