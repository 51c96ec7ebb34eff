#include "io/recorded_detections.h"

#include <algorithm>
#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

#include <Eigen/LU>

#include "base/decimal_seconds.h"
#include "io/text/number_text.h"
#include "io/text/plausible.h"
#include "io/text/text_file.h"

namespace waymark::io {
namespace {

namespace fs = std::filesystem;

// The times of all frames.
fs::path timesBeside(const fs::path& path) { return path.parent_path() / "frames.csv"; }

using FramesByTime = std::map<std::int64_t, std::vector<slam::MarkerDetection>>;

// Calls parse(line) for each line that is not a comment; it returns why the line is wrong, or
// empty.
template <typename Parse>
Status forEachLine(const std::string& text, const fs::path& path, const Parse& parse) {
  int number = 0;
  for (const std::string_view raw : split(text, '\n')) {
    ++number;
    const std::string_view line = trim(raw.substr(0, raw.find('#')));
    if (line.empty()) continue;
    const std::string fault = parse(line);
    if (fault.empty()) continue;
    return Error{path.string() + ":" + std::to_string(number) + ": " + oneLine(fault)};
  }
  return success();
}

// Of the four corners, square pixels.
using Covariances = std::array<Eigen::Matrix2d, 4>;

constexpr std::size_t kFieldsOfCorners = 11;
constexpr std::size_t kFieldsWithCovariances = 23;
constexpr const char* kCornerFields = "t,id,hamming,x0,y0,x1,y1,x2,y2,x3,y3";
constexpr const char* kCovarianceFields = "xx0,xy0,yy0,...,xx3,xy3,yy3";

// The file's corners go bottom-left, bottom-right, top-right, top-left: ours backwards.
constexpr std::size_t ourCorner(std::size_t file_corner) { return 3 - file_corner; }

// d pixel / d normalized.
Eigen::Matrix2d lensJacobian(const slam::CameraModel& camera, const Eigen::Vector2d& normalized) {
  Eigen::Matrix2d J;
  static_cast<void>(camera.distort(normalized, &J));
  return J;
}

// False when a corner lies outside the lens's range.
bool undistort(const slam::CameraModel& camera, const Covariances& covariances_px2,
               slam::MarkerDetection* detection) {
  if (!slam::undistortCorners(camera, detection)) return false;
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Matrix2d J_inverse = lensJacobian(camera, detection->normalized[i]).inverse();
    detection->covariance[i] = J_inverse * covariances_px2[i] * J_inverse.transpose();
  }
  return true;
}

struct Line {
  std::int64_t time_ns = 0;
  slam::MarkerDetection detection;
  std::optional<Covariances> covariances_px2;
};

// The twelve fields after the corners. The fault names the first corner that has none.
std::optional<Covariances> parseCovariances(std::span<const std::string_view> fields,
                                            std::string* fault) {
  Covariances covariances_px2;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto xx = parseDouble(fields[3 * i]);
    const auto xy = parseDouble(fields[3 * i + 1]);
    const auto yy = parseDouble(fields[3 * i + 2]);
    if (!xx || !xy || !yy || !isCovariance(*xx, *xy, *yy)) {
      *fault = "covariance of corner " + std::to_string(i) +
               " is not three numbers xx, xy, yy of a positive definite matrix";
      return std::nullopt;
    }
    covariances_px2[ourCorner(i)] << *xx, *xy, *xy, *yy;
  }
  return covariances_px2;
}

std::optional<Line> parseDetection(std::string_view text, std::string* fault) {
  const std::vector<std::string_view> fields = split(text, ',');
  if (fields.size() != kFieldsOfCorners && fields.size() != kFieldsWithCovariances) {
    *fault = "has " + std::to_string(fields.size()) + " fields, must be 11: " + kCornerFields +
             ", or 23: the same and " + kCovarianceFields;
    return std::nullopt;
  }
  const auto time_ns = parseSeconds(fields[0]);
  const auto id = parseInteger(fields[1]);
  const auto hamming = parseInteger(fields[2]);
  if (!time_ns || !id || !hamming || *id < 0 || *hamming < 0) {
    *fault = "must begin with a time in seconds, an id and a number of corrected bits";
    return std::nullopt;
  }
  Line line{*time_ns, {}, std::nullopt};
  line.detection.id = *id;
  line.detection.hamming = *hamming;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto x = parseDouble(fields[3 + 2 * i]);
    const auto y = parseDouble(fields[4 + 2 * i]);
    if (!x || !y) {
      *fault = "corner " + std::to_string(i) + " is not two finite numbers";
      return std::nullopt;
    }
    line.detection.pixels[ourCorner(i)] = {*x, *y};
  }
  if (fields.size() == kFieldsWithCovariances) {
    line.covariances_px2 = parseCovariances(std::span(fields).subspan(kFieldsOfCorners), fault);
    if (!line.covariances_px2) return std::nullopt;
  }
  return line;
}

std::string formatDetection(std::int64_t time_ns, const slam::MarkerDetection& detection,
                            const slam::CameraModel& camera) {
  std::string line = formatSeconds(time_ns) + "," + std::to_string(detection.id) + "," +
                     std::to_string(detection.hamming);
  const auto append = [&line](double value) { line += "," + roundTrip(value); };
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d& pixel = detection.pixels[ourCorner(i)];
    append(pixel.x());
    append(pixel.y());
  }
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t corner = ourCorner(i);
    const Eigen::Matrix2d J = lensJacobian(camera, detection.normalized[corner]);
    const Eigen::Matrix2d covariance_px2 = J * detection.covariance[corner] * J.transpose();
    append(covariance_px2(0, 0));
    append(covariance_px2(0, 1));
    append(covariance_px2(1, 1));
  }
  return line + "\n";
}

// 0 for none.
double reachOf(std::vector<double> coordinates) {
  if (coordinates.empty()) return 0.0;
  constexpr std::size_t kOneBeyondOf = 200;
  const std::size_t beyond = coordinates.size() / kOneBeyondOf;
  const auto reach = coordinates.end() - 1 - static_cast<std::ptrdiff_t>(beyond);
  std::ranges::nth_element(coordinates, reach);
  return std::max(*reach, 0.0);
}

}  // namespace

Result<ImageExtent> readImageExtent(const fs::path& path) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  std::vector<double> x;
  std::vector<double> y;
  const Status read = forEachLine(*text, path, [&](std::string_view fields) -> std::string {
    std::string fault;
    const std::optional<Line> line = parseDetection(fields, &fault);
    if (!line) return fault;
    for (const Eigen::Vector2d& corner : line->detection.pixels) {
      x.push_back(corner.x());
      y.push_back(corner.y());
    }
    return {};
  });
  if (!read) return read.error();
  return ImageExtent{reachOf(std::move(x)), reachOf(std::move(y))};
}

Result<RecordedDetections> readRecordedDetections(const fs::path& path,
                                                  const slam::CameraModel& camera,
                                                  const RecordedDetectionsOptions& options) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  std::optional<std::string> frame_times;
  std::error_code error;
  if (const fs::path times = timesBeside(path); fs::exists(times, error)) {
    Result<std::string> read = readTextFile(times);
    if (!read) return read.error();
    frame_times = std::move(read).value();
  }
  return parseRecordedDetections(*text, frame_times, path, camera, options);
}

Result<RecordedDetections> parseRecordedDetections(const std::string& text,
                                                   const std::optional<std::string>& frame_times,
                                                   const fs::path& path,
                                                   const slam::CameraModel& camera,
                                                   const RecordedDetectionsOptions& options) {
  const Eigen::Matrix2d isotropic_px2 =
      options.corner_sigma_px * options.corner_sigma_px * Eigen::Matrix2d::Identity();
  const Covariances unknown_px2 = {isotropic_px2, isotropic_px2, isotropic_px2, isotropic_px2};
  RecordedDetections recorded;
  FramesByTime frames;
  const fs::path times = timesBeside(path);
  if (frame_times) {
    const Status read = forEachLine(*frame_times, times, [&](std::string_view line) -> std::string {
      const auto time_ns = parseSeconds(line);
      if (!time_ns) return "'" + std::string(line) + "' is not a time in seconds";
      frames.try_emplace(*time_ns);
      return {};
    });
    if (!read) return read.error();
  }
  const Status read = forEachLine(text, path, [&](std::string_view fields) -> std::string {
    std::string fault;
    std::optional<Line> line = parseDetection(fields, &fault);
    if (!line) return fault;
    if (frame_times && !frames.contains(line->time_ns)) {
      return "time " + formatSeconds(line->time_ns) + " is not in " + times.string();
    }
    std::vector<slam::MarkerDetection>& frame = frames[line->time_ns];
    if (undistort(camera, line->covariances_px2.value_or(unknown_px2), &line->detection)) {
      frame.push_back(line->detection);
    } else {
      ++recorded.outside_lens;
    }
    return {};
  });
  if (!read) return read.error();
  for (auto& [time_ns, detections] : frames) {
    slam::sortById(&detections);
    recorded.frames.push_back({time_ns, std::move(detections)});
  }
  if (recorded.frames.empty()) return Error{path.string() + ": has no frames"};
  return recorded;
}

std::string formatRecordedDetections(std::span<const RecordedFrame> frames,
                                     const slam::CameraModel& camera) {
  std::string text = std::string("# ") + kCornerFields + "," + kCovarianceFields +
                     ": seconds, pixels, square pixels; corners bottom-left, bottom-right, "
                     "top-right, top-left\n";
  for (const RecordedFrame& frame : frames) {
    for (const slam::MarkerDetection& detection : frame.detections) {
      text += formatDetection(frame.time_ns, detection, camera);
    }
  }
  return text;
}

std::string formatFrameTimes(std::span<const RecordedFrame> frames) {
  std::string text = "# t: seconds, of every frame, also those without a marker\n";
  for (const RecordedFrame& frame : frames) text += formatSeconds(frame.time_ns) + "\n";
  return text;
}

}  // namespace waymark::io
