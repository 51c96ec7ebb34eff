// How far things that are known to be somewhere appear beside where an estimated pose puts them
// (seed 2, table 1): the distance in the image between a target through the estimated pose and
// through the true one.
//
//   targets DIRECTORY TRAJECTORY.tum [--during "table A"]
//
// DIRECTORY: of `waymark simulate table`. --during: an event of its simulation.json; these frames
// are told of by themselves. The trajectory's world is the scene's: surveyed natural markers, or a
// map with the markers where they are.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "io/calibrations/calibration_file.h"
#include "io/text/json_node.h"
#include "io/text/text_file.h"
#include "io/trajectory.h"
#include "slam/geometry/camera_model.h"
#include "tests/bench/command_line.h"
#include "tools/exit_code.h"

namespace waymark::bench {
namespace {

namespace fs = std::filesystem;

struct Target {
  std::string name;
  Eigen::Vector3d p_w;
};

// Seconds since the first frame.
struct Interval {
  double begin_s = 0.0;
  double end_s = 0.0;
};

// take: called with each element of a file's list.
template <typename Take>
Status readList(const fs::path& file, const char* key, const Take& take) {
  const Result<std::string> text = io::readTextFile(file);
  if (!text) return text.error();
  const Result<io::Json> json = io::parseJson(*text, file.string());
  if (!json) return json.error();
  std::string fault;
  for (const io::JsonNode& node : io::JsonNode(*json, &fault).at(key).elements()) take(node);
  if (!fault.empty()) return Error{file.string() + ": " + fault};
  return success();
}

Result<Interval> readEvent(const fs::path& file, const std::string& what) {
  std::optional<Interval> found;
  const Status read = readList(file, "events", [&](const io::JsonNode& node) {
    if (node.at("what").text() != what) return;
    found = Interval{node.at("begin_s").number(), node.at("end_s").number()};
  });
  if (!read) return read.error();
  if (!found) return Error{file.string() + ": no event '" + what + "'"};
  return *found;
}

Result<std::vector<Target>> readTargets(const fs::path& file) {
  std::vector<Target> targets;
  const Status read = readList(file, "targets", [&](const io::JsonNode& node) {
    targets.push_back({node.at("name").text(), node.at("p").point3()});
  });
  if (!read) return read.error();
  return targets;
}

struct Errors {
  std::vector<double> px;

  [[nodiscard]] double mean() const {
    double mean = 0.0;
    for (const double e : px) mean += e / static_cast<double>(px.size());
    return mean;
  }
  [[nodiscard]] double deviation() const {
    const double middle = mean();
    double squares = 0.0;
    for (const double e : px) squares += (e - middle) * (e - middle);
    return std::sqrt(squares / static_cast<double>(px.size()));
  }
  [[nodiscard]] double worst() const { return *std::ranges::max_element(px); }

  void print(const std::string& name) const {
    std::printf("  %-10s %6zu views: %.2f px, standard deviation %.2f, worst %.2f\n", name.c_str(),
                px.size(), mean(), deviation(), worst());
  }
};

io::Json summaryOf(const Errors& errors) {
  if (errors.px.empty()) return nullptr;
  return {{"mean", errors.mean()}, {"deviation", errors.deviation()}, {"worst", errors.worst()}};
}

Status compare(const fs::path& directory, const fs::path& trajectory, const std::string& event,
               const fs::path& json) {
  const auto calibration = io::readCalibration(directory / "calib.yml");
  if (!calibration) return calibration.error();
  const auto targets = readTargets(directory / "gt_targets.json");
  if (!targets) return targets.error();
  const auto truth = io::readTrajectory(directory / "gt_traj.txt");
  if (!truth) return truth.error();
  const auto estimate = io::readTrajectory(trajectory);
  if (!estimate) return estimate.error();
  const slam::CameraModel camera(*calibration);
  Interval interval;
  if (!event.empty()) {
    const Result<Interval> read = readEvent(directory / "simulation.json", event);
    if (!read) return read.error();
    interval = *read;
  }

  std::map<std::string, Errors> of_target;
  Errors all, during;
  std::size_t frames = 0;
  for (const io::StampedPose& pose : *estimate) {
    const auto at =
        std::ranges::lower_bound(*truth, pose.time_ns - 500'000, {}, &io::StampedPose::time_ns);
    if (at == truth->end() || at->time_ns > pose.time_ns + 500'000) continue;
    ++frames;
    const double since_s = 1e-9 * static_cast<double>(at->time_ns - truth->front().time_ns);
    const bool is_during = since_s >= interval.begin_s && since_s < interval.end_s;
    for (const Target& target : *targets) {
      const auto expected = camera.project(at->T_w_c.inverse() * target.p_w);
      const auto estimated = camera.project(pose.T_w_c.inverse() * target.p_w);
      if (!expected || !camera.inImage(*expected, 0.0) || !estimated) continue;
      const double px = (*estimated - *expected).norm();
      of_target[target.name].px.push_back(px);
      all.px.push_back(px);
      if (is_during) during.px.push_back(px);
    }
  }
  std::printf("%zu of %zu frames have a pose\n", frames, truth->size());
  for (const auto& [name, errors] : of_target) errors.print(name);
  if (!all.px.empty()) all.print("all");
  if (!during.px.empty()) during.print(event);
  if (json.empty()) return success();
  io::Json summary = {{"frames", truth->size()}, {"posed", frames}, {"px", summaryOf(all)}};
  if (!event.empty()) summary["during_px"] = summaryOf(during);
  return io::writeTextFile(json, summary.dump(1) + "\n");
}

}  // namespace
}  // namespace waymark::bench

int main(int argc, char** argv) {
  using namespace waymark;
  std::string directory, trajectory, event, json;
  CLI::App app{"Reprojection errors of known targets", "targets"};
  app.add_option("directory", directory, "Of `waymark simulate table`")->required();
  app.add_option("trajectory", trajectory, "TUM, in the scene's world")->required();
  app.add_option("--during", event, "An event of the scene, told of by itself as well");
  app.add_option("--json", json, "What is said of all targets into this file as well");
  if (const auto exit_code = bench::parse(app, argc, argv)) return *exit_code;
  return bench::exitCodeOf("targets", bench::compare(directory, trajectory, event, json));
}
