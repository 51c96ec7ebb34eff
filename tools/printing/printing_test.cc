// What is printed, measured on the page as a renderer shows it.
#include <cmath>
#include <filesystem>
#include <optional>

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include "io/text/text_file.h"
#include "slam/detection/marker_detector.h"
#include "tests/process.h"
#include "tests/temporary_directory.h"
#include "tools/calibration/board_detector.h"
#include "tools/printing/board_sheet.h"
#include "tools/printing/marker_sheets.h"

namespace waymark::printing {
namespace {

using waymark::testing::ProgramResult;
using waymark::testing::runProgram;
using waymark::testing::TemporaryDirectory;

constexpr double kPixelsPerMm = 10.0;  // 254 dots per inch

// The page as a grey picture. Empty, with a failed test, where there is none.
cv::Mat rendered(const std::vector<PdfPage>& pages, int number) {
  const TemporaryDirectory directory;
  EXPECT_TRUE(io::writeTextFile(directory / "page.pdf", formatPdf(pages, "test")));
  const std::string page = std::to_string(number);
  const ProgramResult result =
      runProgram({PDFTOPPM, "-r", "254", "-gray", "-singlefile", "-f", page, "-l", page,
                  directory / "page.pdf", directory / "page"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.err, "");
  cv::Mat picture = cv::imread((directory / "page.pgm").string(), cv::IMREAD_GRAYSCALE);
  EXPECT_FALSE(picture.empty());
  return picture;
}

ImageView viewOf(const cv::Mat& grey) {
  return {grey.data, grey.cols, grey.rows, static_cast<std::ptrdiff_t>(grey.step)};
}

std::vector<slam::MarkerDetection> detected(const cv::Mat& picture,
                                            const slam::Dictionary& dictionary) {
  const slam::CameraModel camera(calibration::roughCalibration(picture.cols, picture.rows));
  slam::MarkerDetector detector(camera, dictionary);
  return detector.detect(viewOf(picture));
}

// On the page, millimetres: pixels count from centres.
Eigen::Vector2d inMm(const Eigen::Vector2d& pixel) {
  return (pixel + Eigen::Vector2d(0.5, 0.5)) / kPixelsPerMm;
}

TEST(MarkerSheets, EveryMarkerIsThereUprightAndTrueToScale) {
  for (const char* name : {"APRILTAG_36h11", "ARUCO_MIP_36h12", "4X4_50"}) {
    const slam::Dictionary dictionary = *slam::Dictionary::byName(name);
    MarkerSheetOptions options;
    options.ids = {0, 1, 2, 3, 17, 18, 19, 20, 30, 31, 32, 49};
    options.marker_size_m = 0.05;
    const auto pages = markerSheets(dictionary, options);
    ASSERT_TRUE(pages) << pages.error().message;
    std::size_t next = 0;
    for (std::size_t p = 0; p < pages->size(); ++p) {
      const auto markers = detected(rendered(*pages, static_cast<int>(p) + 1), dictionary);
      for (const slam::MarkerDetection& marker : markers) {
        ASSERT_LT(next, options.ids.size());
        EXPECT_EQ(marker.id, options.ids[next++]);
        EXPECT_EQ(marker.hamming, 0);
        for (std::size_t k = 0; k < 4; ++k) {
          const Eigen::Vector2d side = inMm(marker.pixels[(k + 1) % 4]) - inMm(marker.pixels[k]);
          EXPECT_NEAR(side.norm(), 50.0, 0.02);
        }
        // Upright: the first side runs to the right.
        const Eigen::Vector2d top = marker.pixels[1] - marker.pixels[0];
        EXPECT_GT(top.x(), 499.0);
        EXPECT_NEAR(top.y(), 0.0, 0.5);
      }
    }
    EXPECT_EQ(next, options.ids.size()) << name;
    EXPECT_EQ(pages->size(), 2U);
  }
}

TEST(MarkerSheets, LargeMarkersTurnThePageOrAreRejected) {
  const slam::Dictionary dictionary = *slam::Dictionary::byName("4X4_50");
  MarkerSheetOptions options;
  options.ids = {3};
  options.marker_size_m = 0.12;
  options.page.paper = {300.0, 180.0};
  ASSERT_TRUE(markerSheets(dictionary, options));
  options.marker_size_m = 0.125;  // with its border and caption too high for the page as it is
  options.page.paper = {400.0, 190.0};
  const auto upright = markerSheets(dictionary, options);
  ASSERT_TRUE(upright) << upright.error().message;
  EXPECT_EQ(upright->front().width_mm, 190.0);
  options.marker_size_m = 0.3;
  const auto rejected = markerSheets(dictionary, options);
  ASSERT_FALSE(rejected);
  EXPECT_NE(rejected.error().message.find("the page has room for 380x156"), std::string::npos)
      << rejected.error().message;
  options.ids = {50};
  EXPECT_EQ(markerSheets(dictionary, options).error().message, "4X4_50 has ids 0 to 49, not 50");
}

// Where a row of pixels is dark, as the centres of its dark stretches, millimetres.
std::vector<double> darkCentres(const cv::Mat& picture, int row, int end_column) {
  std::vector<double> centres;
  double weight = 0.0;
  double moment = 0.0;
  for (int x = 0; x <= end_column; ++x) {
    const double dark = x < end_column ? 255.0 - picture.at<std::uint8_t>(row, x) : 0.0;
    if (dark > 10.0) {
      weight += dark;
      moment += dark * (x + 0.5);
    } else if (weight > 0.0) {
      centres.push_back(moment / weight / kPixelsPerMm);
      weight = moment = 0.0;
    }
  }
  return centres;
}

TEST(Paper, TheRulerIsExact) {
  const PageOptions options;
  PdfPage page = emptyPage(options);
  addFooter(options, "text", &page);
  const cv::Mat picture = rendered({page}, 1);
  // 3.5 mm above the lower margin only the ticks of whole centimetres reach.
  const int row = static_cast<int>((297.0 - options.margin_mm - 3.5) * kPixelsPerMm);
  const auto ticks = darkCentres(picture, row, static_cast<int>(115.0 * kPixelsPerMm));
  ASSERT_EQ(ticks.size(), 11U);
  EXPECT_NEAR(ticks.back() - ticks.front(), 100.0, 0.05);
  for (std::size_t i = 0; i < ticks.size(); ++i) {
    EXPECT_NEAR(ticks[i] - ticks.front(), 10.0 * static_cast<double>(i), 0.05);
  }
}

TEST(Paper, Names) {
  EXPECT_EQ(paperFromText("A4")->height_mm, 297.0);
  EXPECT_EQ(paperFromText("letter")->width_mm, 215.9);
  EXPECT_EQ(paperFromText("600x900.5")->height_mm, 900.5);
  for (const char* text : {"", "a17", "10x10", "x", "600x", "600xinf", "-600x900", "1e9x100"}) {
    EXPECT_FALSE(paperFromText(text)) << text;
  }
  EXPECT_EQ(millimetres(100.0), "100");
  EXPECT_EQ(millimetres(12.5), "12.5");
}

TEST(BoardSheet, ADetectorFindsEveryCornerInItsPlace) {
  for (const auto kind : {calibration::BoardKind::kCharuco, calibration::BoardKind::kMarkers}) {
    calibration::BoardOptions options;
    options.kind = kind;
    const auto page = boardSheet(options, PageOptions{});
    ASSERT_TRUE(page) << page.error().message;
    const cv::Mat picture = rendered({*page}, 1);
    const calibration::Board board(options);
    calibration::BoardDetector detector(board,
                                        calibration::roughCalibration(picture.cols, picture.rows));
    const auto sight = detector.detect(viewOf(picture));
    ASSERT_TRUE(sight);
    ASSERT_EQ(sight->points.size(), board.points().size());
    const auto onPage = [&](const calibration::BoardPoint& point) {
      const Eigen::Vector3d& p = board.points()[point.index];
      return Eigen::Vector2d(1000.0 * p.x(), -1000.0 * p.y());
    };
    for (const calibration::BoardPoint& point : sight->points) {
      const Eigen::Vector2d moved = inMm(point.pixel) - inMm(sight->points.front().pixel);
      EXPECT_LT((moved - (onPage(point) - onPage(sight->points.front()))).norm(), 0.03);
    }
  }
}

TEST(BoardSheet, TooLargeABoardIsRejected) {
  calibration::BoardOptions options;
  options.square_size_m = 0.04;
  options.marker_size_m = 0.03;
  const auto page = boardSheet(options, PageOptions{});
  ASSERT_FALSE(page);
  EXPECT_EQ(page.error().message, "the board is 280x400 mm, the page has room for 190x263");
  // Turned, a wide one fits.
  options.square_size_m = 0.025;
  options.marker_size_m = 0.018;
  std::swap(options.columns, options.rows);
  EXPECT_EQ(boardSheet(options, PageOptions{})->width_mm, 297.0);
}

TEST(PdfDocument, OddTextAndSeveralPages) {
  PdfPage page{100.0, 50.0, {{10, 10, 5, 5}}, {}, {{10, 30, 4, "a (b) \\ c\n\xC3\xA4"}}};
  const std::string pdf = formatPdf({page, page, page}, "title (1)");
  EXPECT_EQ(pdf, formatPdf({page, page, page}, "title (1)"));
  const cv::Mat picture = rendered({page, page, page}, 3);
  EXPECT_NEAR(picture.cols, 1000, 1);
  EXPECT_NEAR(picture.rows, 500, 1);
  EXPECT_EQ(picture.at<std::uint8_t>(125, 125), 0);
  EXPECT_EQ(picture.at<std::uint8_t>(95, 125), 255);
  EXPECT_NEAR(textWidth_mm("Waymark", 10.0), 42.22, 0.01);
}

}  // namespace
}  // namespace waymark::printing
