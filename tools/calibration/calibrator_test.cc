#include "tools/calibration/calibrator.h"

#include <algorithm>
#include <map>

#include <gtest/gtest.h>

#include "slam/testing/synthetic.h"
#include "tools/calibration/report_picture.h"
#include "tools/calibration/testing/drawn_board.h"

namespace waymark::calibration {
namespace {

slam::Calibration fisheye() {
  slam::Calibration c{
      .width = 640, .height = 480, .fx = 300.0, .fy = 300.5, .cx = 322.0, .cy = 236.0};
  c.model = slam::DistortionModel::kEquidistant;
  c.distortion = {-0.02, 0.01, -0.004, 0.001};
  return c;
}

// Rendered views as a collector takes them.
std::vector<View> photographed(const Board& board, const BoardOptions& options,
                               const testing::Photographer& photographer,
                               const std::vector<slam::Transform>& poses) {
  const testing::DrawnBoard drawn(options);
  const slam::CameraModel& camera = photographer.camera();
  BoardDetector detector(board, roughCalibration(camera.width(), camera.height()));
  ViewCollector collector(board, camera.width(), camera.height());
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const cv::Mat picture = photographer.take(drawn, poses[i], 0.6, 1.5, static_cast<unsigned>(i));
    auto board_view = detector.detect(testing::viewOf(picture));
    if (board_view) {
      collector.offer("frame " + std::to_string(i), std::move(*board_view),
                      testing::viewOf(picture));
    }
  }
  return std::move(collector).take();
}

void expectTruth(const Result<CalibrationReport>& report, const slam::Calibration& truth) {
  ASSERT_TRUE(report) << report.error().message;
  const Solution& solution = report->solution;
  const Eigen::VectorXd error =
      parametersOf(solution.camera, solution.lens) - parametersOf(truth, solution.lens);
  for (Eigen::Index i = 0; i < error.size(); ++i) {
    EXPECT_LT(std::abs(error[i]), 4.0 * solution.sigma(i))
        << parameterNames(solution.lens)[static_cast<std::size_t>(i)] << ": " << error[i];
  }
  EXPECT_LT(std::abs(error[0]) / truth.fx, 2e-3);
  EXPECT_LT(std::abs(error[1]) / truth.fy, 2e-3);
  EXPECT_LT(solution.rms_px, 0.15);
  EXPECT_GT(report->coverage.share(), 0.5);
}

// A set of rendered views is dear: shared by tests.
struct CharucoViews {
  CharucoViews() : photographer(slam::testing::testCalibration()) {
    const slam::CameraModel& camera = photographer.camera();
    views = photographed(board, options, photographer, testing::goodPoses(camera, 0.42, 26));
  }
  static const CharucoViews& get() {
    static const CharucoViews all;
    return all;
  }
  BoardOptions options;
  Board board{options};
  testing::Photographer photographer;
  std::vector<View> views;
};

TEST(Calibrator, CharucoRecoversTheCamera) {
  const CharucoViews& all = CharucoViews::get();
  ASSERT_GE(all.views.size(), 20U);
  const auto report = calibrateCamera(all.board, all.views, Lens::kPlumbBob);
  expectTruth(report, slam::testing::testCalibration());
  EXPECT_TRUE(report->left_out.empty());
  std::size_t points = 0;
  for (const RegionReport& region : report->region_reports) points += region.points;
  EXPECT_EQ(points, report->points);
  EXPECT_EQ(points, report->residuals.size());
  const cv::Mat picture = drawReport(*report, "title");
  EXPECT_EQ(picture.channels(), 3);
  EXPECT_GT(picture.cols, 1000);
}

TEST(Calibrator, MarkersRecoverTheCamera) {
  BoardOptions options;
  options.kind = BoardKind::kMarkers;
  options.columns = 5;
  options.rows = 7;
  options.square_size_m = 0.035;
  options.marker_size_m = 0.027;
  options.dictionary = "APRILTAG_36h11";
  const Board board(options);
  const testing::Photographer photographer(slam::testing::testCalibration());
  const auto views = photographed(board, options, photographer,
                                  testing::goodPoses(photographer.camera(), 0.42, 20));
  expectTruth(calibrateCamera(board, views, Lens::kPlumbBob), slam::testing::testCalibration());
}

TEST(Calibrator, FisheyesAreRecovered) {
  const CharucoViews& all = CharucoViews::get();
  const testing::Photographer photographer(fisheye());
  const auto views = photographed(all.board, all.options, photographer,
                                  testing::goodPoses(photographer.camera(), 0.26, 24));
  expectTruth(calibrateCamera(all.board, views, Lens::kEquidistant), fisheye());
}

TEST(Calibrator, AViewThatDoesNotFitIsNamed) {
  const CharucoViews& all = CharucoViews::get();
  std::vector<View> views = all.views;
  // Another photograph, of a board that is bent: its right half is nearer.
  const std::string name = views[4].name;
  const testing::DrawnBoard drawn(all.options);
  cv::Mat picture(views[4].height, views[4].width, CV_8U, views[4].pixels.data());
  cv::Mat_<float> map_x(picture.size());
  cv::Mat_<float> map_y(picture.size());
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      map_x(y, x) = static_cast<float>(x);
      map_y(y, x) = static_cast<float>(y + 2.5 * std::sin(0.03 * x));
    }
  }
  cv::Mat bent;
  cv::remap(picture, bent, map_x, map_y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  BoardDetector detector(all.board, roughCalibration(bent.cols, bent.rows));
  auto board_view = detector.detect(testing::viewOf(bent));
  ASSERT_TRUE(board_view);
  views[4].board_view = std::move(*board_view);
  views[4].pixels.assign(bent.datastart, bent.dataend);

  const auto report = calibrateCamera(all.board, views, Lens::kPlumbBob);
  expectTruth(report, slam::testing::testCalibration());
  ASSERT_EQ(report->left_out.size(), 1U);
  EXPECT_EQ(report->left_out.front().name, name);
  EXPECT_EQ(report->views.size(), views.size() - 1);
}

TEST(Calibrator, ViewsThatCannotSayAreRejected) {
  const CharucoViews& all = CharucoViews::get();
  const slam::CameraModel& camera = all.photographer.camera();
  const auto complaint = [&](const std::vector<slam::Transform>& poses) {
    const auto views = photographed(all.board, all.options, all.photographer, poses);
    const auto report = calibrateCamera(all.board, views, Lens::kPlumbBob);
    return report ? "none" : report.error().message;
  };
  std::vector<slam::Transform> flat;
  std::vector<slam::Transform> one_place;
  for (int i = 0; i < 12; ++i) {
    const int row = i / 4;
    flat.push_back(testing::boardAt(camera, {140.0 + 120.0 * (i % 4), 120.0 + 110.0 * row}, 0.45,
                                    0.0, 0.0, 0.1 * i));
    one_place.push_back(testing::boardAt(camera, {150.0, 150.0}, 0.6, 0.5 * std::cos(i),
                                         0.5 * std::sin(i), 0.5 * i));
  }
  EXPECT_NE(complaint(flat).find("no view tilts the board"), std::string::npos) << complaint(flat);
  const std::string place = complaint(one_place);
  EXPECT_NE(place.find("% of the picture, too few in: "), std::string::npos) << place;
  EXPECT_NE(place.find("bottom right"), std::string::npos) << place;
  EXPECT_NE(complaint({flat[0], flat[1], flat[2]}).find("at least 6"), std::string::npos);
}

// A lens that bends little needs no denominator: any that the numerator cancels would do.
TEST(Calibrator, ALensWithTooManyCoefficientsIsRejected) {
  const CharucoViews& all = CharucoViews::get();
  const auto report = calibrateCamera(all.board, all.views, Lens::kRational);
  if (report) {
    EXPECT_LE(report->solution.sigma(9), CalibratorOptions{}.max_rational_sigma);
  }
  CalibratorOptions strict;
  strict.max_rational_sigma = 1e-6;
  const auto rejected = calibrateCamera(all.board, all.views, Lens::kRational, strict);
  ASSERT_FALSE(rejected);
  EXPECT_NE(rejected.error().message.find("try plumb_bob"), std::string::npos);
}

TEST(ViewCollector, KeepsWhatIsNewAndWhatIsSharp) {
  const CharucoViews& all = CharucoViews::get();
  ViewCollector collector(all.board, 640, 480, {.max_views = 12});
  const View& first = all.views.front();
  const auto offer = [&](const View& view, double blur_px) {
    BoardView board_view = view.board_view;
    board_view.blur_px = blur_px;
    collector.offer(view.name + " again", board_view, view.image());
  };
  offer(first, 1.0);
  offer(first, 0.95);  // hardly sharper
  EXPECT_EQ(collector.count(), 1U);
  offer(first, 0.5);
  EXPECT_EQ(collector.count(), 1U);
  for (const View& view : all.views) offer(view, 0.6);
  EXPECT_LE(collector.count(), 12U);
  EXPECT_GE(collector.count(), 6U);
  EXPECT_GT(collector.coverage().share(), 0.5);
  const std::vector<View> kept = std::move(collector).take();
  EXPECT_EQ(kept.front().board_view.blur_px, 0.5);
}

TEST(ViewCollector, MotionIsLeftOut) {
  const CharucoViews& all = CharucoViews::get();
  ViewCollector collector(all.board, 640, 480);
  for (const View& view : all.views) {
    BoardView board_view = view.board_view;
    if (view.name == all.views[2].name) board_view.blur_px *= 2.0;
    collector.offer(view.name, board_view, view.image());
  }
  const auto kept = std::move(collector).take();
  EXPECT_EQ(kept.size(), all.views.size() - 1);
  EXPECT_TRUE(std::none_of(kept.begin(), kept.end(),
                           [&](const View& view) { return view.name == all.views[2].name; }));
}

TEST(Coverage, NamesWhatIsMissing) {
  Coverage coverage(640, 480);
  EXPECT_EQ(coverage.share(), 0.0);
  for (int y = 0; y < 480; y += 10) {
    for (int x = 0; x < 400; x += 10) coverage.add({x, y});
  }
  EXPECT_EQ(coverage.missing(), "top right, right, bottom right");
  EXPECT_NEAR(coverage.share(), 0.7, 0.1);
  coverage.add({-0.5, -0.5});
  coverage.add({700.0, 500.0});  // beyond the border: the last cell
  EXPECT_GT(coverage.counts().back(), 0);
}

}  // namespace
}  // namespace waymark::calibration
