#include "tools/eval_command.h"

#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "io/map_file.h"
#include "io/map_picture.h"
#include "io/number_text.h"
#include "io/trajectory.h"
#include "tools/evaluation.h"
#include "tools/exit_code.h"

namespace waymark::tools {
namespace {

struct EvalArguments {
  std::string truth;
  std::string estimate;
  std::string truth_map;
  std::string map;
  std::string picture;
  double tolerance_ms = 2.0;
  bool json = false;
};

struct Evaluation {
  TrajectoryErrors trajectory;
  std::optional<MapErrors> map;
};

nlohmann::ordered_json toJson(const ErrorStatistics& metres) {
  return {
      {"mean", metres.mean}, {"rms", metres.rms}, {"median", metres.median}, {"max", metres.max}};
}

std::string jsonText(const Evaluation& evaluation) {
  const TrajectoryErrors& t = evaluation.trajectory;
  nlohmann::ordered_json json = {{"truth_poses", t.truth_poses},
                                 {"matched", t.matched},
                                 {"coverage", t.coverage()},
                                 {"ate_m", toJson(t.ate_m)},
                                 {"segments", t.segments}};
  // Without one stretch of 25 cm there is no relative error, and 0 would look like a good one.
  json["t_rel_percent"] = t.segments > 0 ? nlohmann::ordered_json(t.t_rel_percent) : nullptr;
  json["r_rel_deg_per_25cm"] = t.segments > 0 ? nlohmann::ordered_json(t.r_rel_deg) : nullptr;
  if (evaluation.map) {
    json["ace_m"] = toJson(evaluation.map->ace_m);
    json["common_markers"] = evaluation.map->common;
    json["missing_markers"] = evaluation.map->missing;
    json["unknown_markers"] = evaluation.map->unknown;
  }
  return json.dump(2) + "\n";
}

std::string statisticsText(const char* name, const ErrorStatistics& metres) {
  const auto mm = [](double m) { return io::fixed(1000.0 * m, 3); };
  return std::string(name) + "   mean " + mm(metres.mean) + " mm, rms " + mm(metres.rms) +
         " mm, median " + mm(metres.median) + " mm, max " + mm(metres.max) + " mm\n";
}

std::string idsText(const char* what, const std::vector<int>& ids) {
  if (ids.empty()) return {};
  std::string text = std::string("      ") + what + ":";
  for (const int id : ids) text += " " + std::to_string(id);
  return text + "\n";
}

std::string plainText(const Evaluation& evaluation) {
  const TrajectoryErrors& t = evaluation.trajectory;
  std::string text = "poses " + std::to_string(t.matched) + " of " + std::to_string(t.truth_poses) +
                     " in the truth (" + io::fixed(100.0 * t.coverage(), 1) + " %)\n";
  text += statisticsText("ATE", t.ate_m);
  if (t.segments > 0) {
    text += "t_rel " + io::fixed(t.t_rel_percent, 3) + " % over 25 cm (" +
            std::to_string(t.segments) + " stretches)\n";
    text += "r_rel " + io::fixed(t.r_rel_deg, 3) + " deg per 25 cm\n";
  } else {
    text += "t_rel, r_rel: none, the path is shorter than 25 cm\n";
  }
  if (evaluation.map) {
    text += statisticsText("ACE", evaluation.map->ace_m);
    text += "      " + std::to_string(evaluation.map->common) + " markers in both maps\n";
    text += idsText("missing from the map", evaluation.map->missing);
    text += idsText("not in the truth", evaluation.map->unknown);
  }
  return text;
}

// Everything in the truth's world, in which up and down usually mean something.
Status drawPicture(const EvalArguments& arguments, const io::Trajectory& truth,
                   io::Trajectory estimate, std::vector<io::MarkerCorners> markers,
                   const Evaluation& evaluation) {
  const slam::Transform& T = evaluation.trajectory.T_truth_est;
  for (io::StampedPose& pose : estimate) pose.T_w_c = T * pose.T_w_c;
  for (io::MarkerCorners& marker : markers) {
    for (Eigen::Vector3d& corner : marker.corners) corner = T * corner;
  }
  const std::string ate = io::fixed(1000.0 * evaluation.trajectory.ate_m.mean, 2);
  return io::writeMapPicture(arguments.picture,
                             {.title = "Map and trajectory against the truth: ATE " + ate + " mm",
                              .markers = std::move(markers),
                              .estimate = std::move(estimate),
                              .truth = truth,
                              .z_is_up = true});
}

Result<Evaluation> evaluate(const EvalArguments& arguments) {
  const Result<io::Trajectory> truth = io::readTrajectory(arguments.truth);
  if (!truth) return truth.error();
  const Result<io::Trajectory> estimate = io::readTrajectory(arguments.estimate);
  if (!estimate) return estimate.error();
  std::vector<io::MarkerCorners> markers;
  if (!arguments.map.empty()) {
    Result<std::vector<io::MarkerCorners>> map = io::readMarkerCorners(arguments.map);
    if (!map) return map.error();
    markers = std::move(map).value();
  }

  TrajectoryOptions options;
  options.tolerance_ns = std::llround(1e6 * arguments.tolerance_ms);
  const Result<TrajectoryErrors> trajectory = compareTrajectories(*truth, *estimate, options);
  if (!trajectory) return Error{arguments.estimate + ": " + trajectory.error().message};
  Evaluation evaluation{*trajectory, std::nullopt};
  if (!arguments.truth_map.empty()) {
    const auto truth_map = io::readMarkerCorners(arguments.truth_map);
    if (!truth_map) return truth_map.error();
    const Result<MapErrors> map = compareMaps(*truth_map, markers);
    if (!map) return Error{arguments.map + ": " + map.error().message};
    evaluation.map = *map;
  }
  if (!arguments.picture.empty()) {
    const Status drawn = drawPicture(arguments, *truth, *estimate, std::move(markers), evaluation);
    if (!drawn) return drawn.error();
  }
  return evaluation;
}

}  // namespace

void addEvalCommand(CLI::App& app, int* exit_code) {
  CLI::App* command =
      app.add_subcommand("eval", "Measure a trajectory and a map against the truth");
  const auto arguments = std::make_shared<EvalArguments>();
  command->add_option("--truth", arguments->truth, "True trajectory, TUM format")->required();
  command->add_option("--estimate", arguments->estimate, "Trajectory to measure, TUM format")
      ->required();
  CLI::Option* map = command->add_option("--map", arguments->map, "Map to measure, map.json");
  command->add_option("--truth-map", arguments->truth_map, "True marker corners, gt_map.json")
      ->needs(map);
  command->add_option("--picture", arguments->picture,
                      "Draw map and trajectories into this SVG file");
  command
      ->add_option("--tolerance", arguments->tolerance_ms,
                   "Poses of one frame are at most this far apart in time, ms")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber);
  command->add_flag("--json", arguments->json, "Print JSON");
  command->callback([arguments, exit_code] {
    const Result<Evaluation> evaluation = evaluate(*arguments);
    if (!evaluation) {
      std::fprintf(stderr, "waymark: %s\n", evaluation.error().message.c_str());
      *exit_code = kBadInput;
      return;
    }
    const std::string text = arguments->json ? jsonText(*evaluation) : plainText(*evaluation);
    std::fputs(text.c_str(), stdout);
  });
}

}  // namespace waymark::tools
