#include "io/trajectory.h"

#include <array>
#include <cmath>
#include <optional>
#include <string_view>

#include "base/decimal_seconds.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"

namespace waymark::io {
namespace {

constexpr int kPositionDecimals = 9;
constexpr int kQuaternionDecimals = 12;

// One line without comment. On failure *fault says why.
std::optional<StampedPose> parsePose(std::string_view line, std::string* fault) {
  const std::vector<std::string_view> fields = split(line, ' ');
  if (fields.size() != 8) {
    *fault =
        "has " + std::to_string(fields.size()) + " fields, must be 8: time tx ty tz qx qy qz qw";
    return std::nullopt;
  }
  StampedPose pose;
  const std::optional<std::int64_t> time_ns = parseSeconds(fields[0]);
  if (!time_ns) {
    *fault = "'" + oneLine(fields[0]) + "' is not a time in seconds";
    return std::nullopt;
  }
  pose.time_ns = *time_ns;
  std::array<double, 7> v{};
  for (std::size_t i = 0; i < v.size(); ++i) {
    const std::optional<double> value = parseDouble(fields[i + 1]);
    if (!value) {
      *fault = "'" + oneLine(fields[i + 1]) + "' is not a finite number";
      return std::nullopt;
    }
    v[i] = *value;
  }
  const Eigen::Quaterniond q(v[6], v[3], v[4], v[5]);
  if (std::abs(q.norm() - 1.0) > 1e-3) {
    *fault = "the quaternion's length is " + fixed(q.norm(), 6) + ", must be 1";
    return std::nullopt;
  }
  pose.T_w_c = slam::Transform::fromQuaternion(q, {v[0], v[1], v[2]});
  return pose;
}

}  // namespace

Result<Trajectory> readTrajectory(const std::filesystem::path& path) {
  const Result<std::string> text = readTextFile(path);
  if (!text) return text.error();
  Trajectory trajectory;
  int line_number = 0;
  for (const std::string_view raw : split(*text, '\n')) {
    ++line_number;
    const std::string_view line = trim(raw.substr(0, raw.find('#')));
    if (line.empty()) continue;
    std::string fault;
    const std::optional<StampedPose> pose = parsePose(line, &fault);
    if (!pose) return Error{path.string() + ":" + std::to_string(line_number) + ": " + fault};
    trajectory.push_back(*pose);
  }
  return trajectory;
}

std::string formatTrajectory(const Trajectory& trajectory) {
  std::string text = "# time tx ty tz qx qy qz qw (seconds, metres; camera in world)\n";
  for (const StampedPose& pose : trajectory) {
    const Eigen::Quaterniond q = pose.T_w_c.quaternion();
    text += formatSeconds(pose.time_ns);
    for (const double v : {pose.T_w_c.p.x(), pose.T_w_c.p.y(), pose.T_w_c.p.z()}) {
      text += ' ' + fixed(v, kPositionDecimals);
    }
    for (const double v : {q.x(), q.y(), q.z(), q.w()}) text += ' ' + fixed(v, kQuaternionDecimals);
    text += '\n';
  }
  return text;
}

Status writeTrajectory(const std::filesystem::path& path, const Trajectory& trajectory) {
  return writeTextFile(path, formatTrajectory(trajectory));
}

}  // namespace waymark::io
