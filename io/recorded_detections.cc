#include "io/recorded_detections.h"

#include <algorithm>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include <Eigen/LU>

#include "base/decimal_seconds.h"
#include "io/number_text.h"
#include "io/text_file.h"

namespace waymark::io {
namespace {

namespace fs = std::filesystem;

using FramesByTime = std::map<std::int64_t, std::vector<slam::MarkerDetection>>;

// Calls parse(line) for each line that is not a comment; it returns why the line is wrong, or
// empty.
template <typename Parse>
Status forEachLine(const fs::path& path, const Parse& parse) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  int number = 0;
  for (const std::string_view raw : split(*text, '\n')) {
    ++number;
    const std::string_view line = trim(raw.substr(0, raw.find('#')));
    if (line.empty()) continue;
    const std::string fault = parse(line);
    if (!fault.empty()) return Error{path.string() + ":" + std::to_string(number) + ": " + fault};
  }
  return success();
}

// False when a corner lies outside the lens's range.
bool undistort(const slam::CameraModel& camera, double sigma_px, slam::MarkerDetection* detection) {
  for (std::size_t i = 0; i < 4; ++i) {
    const auto normalised = camera.undistort(detection->pixels[i]);
    if (!normalised) return false;
    Eigen::Matrix2d J;  // pixel by normalised
    static_cast<void>(camera.distort(*normalised, &J));
    const Eigen::Matrix2d J_inverse = J.inverse();
    detection->normalised[i] = *normalised;
    detection->covariance[i] = sigma_px * sigma_px * J_inverse * J_inverse.transpose();
  }
  return true;
}

struct Line {
  std::int64_t time_ns = 0;
  slam::MarkerDetection detection;
};

std::optional<Line> parseDetection(std::string_view text, std::string* fault) {
  const std::vector<std::string_view> fields = split(text, ',');
  if (fields.size() != 11) {
    *fault = "has " + std::to_string(fields.size()) +
             " fields, must be 11: t,id,hamming,x0,y0,x1,y1,x2,y2,x3,y3";
    return std::nullopt;
  }
  const auto time_ns = parseSeconds(fields[0]);
  const auto id = parseInteger(fields[1]);
  const auto hamming = parseInteger(fields[2]);
  if (!time_ns || !id || !hamming || *id < 0 || *hamming < 0) {
    *fault = "must begin with a time in seconds, an id and a number of corrected bits";
    return std::nullopt;
  }
  Line line{*time_ns, {}};
  line.detection.id = *id;
  line.detection.hamming = *hamming;
  for (std::size_t i = 0; i < 4; ++i) {
    const auto x = parseDouble(fields[3 + 2 * i]);
    const auto y = parseDouble(fields[4 + 2 * i]);
    if (!x || !y) {
      *fault = "corner " + std::to_string(i) + " is not two finite numbers";
      return std::nullopt;
    }
    // Bottom-left, bottom-right, top-right, top-left: ours backwards.
    line.detection.pixels[3 - i] = {*x, *y};
  }
  return line;
}

}  // namespace

Result<RecordedDetections> readRecordedDetections(const fs::path& path,
                                                  const slam::CameraModel& camera,
                                                  const RecordedDetectionsOptions& options) {
  RecordedDetections recorded;
  FramesByTime frames;
  const fs::path times = path.parent_path() / "frames.csv";
  std::error_code error;
  const bool all_times = fs::exists(times, error);
  if (all_times) {
    const Status read = forEachLine(times, [&](std::string_view line) -> std::string {
      const auto time_ns = parseSeconds(line);
      if (!time_ns) return "'" + std::string(line) + "' is not a time in seconds";
      frames.try_emplace(*time_ns);
      return {};
    });
    if (!read) return read.error();
  }
  const Status read = forEachLine(path, [&](std::string_view text) -> std::string {
    std::string fault;
    std::optional<Line> line = parseDetection(text, &fault);
    if (!line) return fault;
    if (all_times && !frames.contains(line->time_ns)) {
      return "time " + formatSeconds(line->time_ns) + " is not in " + times.string();
    }
    std::vector<slam::MarkerDetection>& frame = frames[line->time_ns];
    if (undistort(camera, options.corner_sigma_px, &line->detection)) {
      frame.push_back(line->detection);
    } else {
      ++recorded.outside_lens;
    }
    return {};
  });
  if (!read) return read.error();
  for (auto& [time_ns, detections] : frames) {
    std::stable_sort(detections.begin(), detections.end(),
                     [](const auto& a, const auto& b) { return a.id < b.id; });
    recorded.frames.push_back({time_ns, std::move(detections)});
  }
  if (recorded.frames.empty()) return Error{path.string() + ": has no frames"};
  return recorded;
}

}  // namespace waymark::io
