#include "tools/eval_report.h"

#include <vector>

#include <nlohmann/json.hpp>

#include "io/text/number_text.h"

namespace waymark::tools {
namespace {

using Json = nlohmann::ordered_json;

Json toJson(const ErrorStatistics& metres) {
  return {
      {"mean", metres.mean}, {"rms", metres.rms}, {"median", metres.median}, {"max", metres.max}};
}

void add(const TrajectoryErrors& t, Json* json) {
  (*json)["truth_poses"] = t.truth_poses;
  (*json)["matched"] = t.matched;
  (*json)["coverage"] = t.coverage();
  (*json)["ate_m"] = toJson(t.ate_m);
  (*json)["segments"] = t.segments;
  // Without one stretch of 25 cm there is no relative error, and 0 would look like a good one.
  (*json)["t_rel_percent"] = t.segments > 0 ? Json(t.t_rel_percent) : Json();
  (*json)["r_rel_deg_per_25cm"] = t.segments > 0 ? Json(t.r_rel_deg) : Json();
}

void add(const MapErrors& map, Json* json) {
  (*json)["ace_m"] = toJson(map.ace_m);
  (*json)["common_markers"] = map.common;
  (*json)["pieces"] = Json::array();
  for (const PieceErrors& piece : map.pieces) {
    (*json)["pieces"].push_back(
        {{"piece", piece.piece}, {"markers", piece.markers}, {"ace_m", toJson(piece.ace_m)}});
  }
  (*json)["missing_markers"] = map.missing;
  (*json)["unknown_markers"] = map.unknown;
}

Json toJson(const AccuracyLimit& limit) {
  return {{"frames", limit.frames},
          {"views", limit.views},
          {"gross_views", limit.outlier_views},
          {"markers", limit.map.common},
          {"corner_rms_px", limit.corner_rms_px},
          {"ate_m", toJson(limit.trajectory.ate_m)},
          {"ace_m", toJson(limit.map.ace_m)}};
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

std::string text(const TrajectoryErrors& t) {
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
  return text;
}

std::string text(const ViewCoverage& coverage) {
  return "in view of a mapped marker: " + std::to_string(coverage.localized) + " of " +
         std::to_string(coverage.frames) + " frames localized (" +
         io::fixed(100.0 * coverage.share(), 1) + " %)\n";
}

// Where there are several.
std::string piecesText(const std::vector<PieceErrors>& pieces) {
  std::string text;
  for (const PieceErrors& piece : pieces) {
    if (pieces.size() == 1) break;
    text += "      piece " + std::to_string(piece.piece) + ": " + std::to_string(piece.markers) +
            " markers, ACE mean " + io::fixed(1e3 * piece.ace_m.mean, 3) + " mm\n";
  }
  return text;
}

std::string text(const MapErrors& map) {
  const std::size_t pieces = map.pieces.size();
  return statisticsText("ACE", map.ace_m) + "      " + std::to_string(map.common) +
         " markers in both maps" +
         (pieces > 1 ? ", of " + std::to_string(pieces) + " pieces, each aligned by itself" : "") +
         "\n" + piecesText(map.pieces) + idsText("missing from the map", map.missing) +
         idsText("not in the truth", map.unknown);
}

// "-" where the limit is exact.
std::string ratioText(double ours_m, double limit_m) {
  return limit_m > 0.0 ? io::fixed(ours_m / limit_m, 2) : "-";
}

std::string limitText(const Evaluation& evaluation) {
  const AccuracyLimit& limit = *evaluation.limit;
  std::string text = "limit from " + std::to_string(limit.frames) + " frames, " +
                     std::to_string(limit.views) + " views of " + std::to_string(limit.map.common) +
                     " markers; corners " + io::fixed(limit.corner_rms_px, 3) +
                     " px RMS from the truth, " + std::to_string(limit.outlier_views) +
                     " gross views left out\n";
  text += statisticsText("ATE", limit.trajectory.ate_m);
  text += statisticsText("ACE", limit.map.ace_m);
  if (evaluation.trajectory) {
    text += "ATE / limit " +
            ratioText(evaluation.trajectory->ate_m.mean, limit.trajectory.ate_m.mean) + "\n";
  }
  if (evaluation.map) {
    text += "ACE / limit " + ratioText(evaluation.map->ace_m.mean, limit.map.ace_m.mean) + "\n";
  }
  return text;
}

}  // namespace

std::string plainText(const Evaluation& evaluation) {
  std::string all;
  if (evaluation.trajectory) all += text(*evaluation.trajectory);
  if (evaluation.coverage) all += text(*evaluation.coverage);
  if (evaluation.map) all += text(*evaluation.map);
  if (evaluation.limit) all += limitText(evaluation);
  return all;
}

std::string jsonText(const Evaluation& evaluation) {
  Json json = Json::object();
  if (evaluation.trajectory) add(*evaluation.trajectory, &json);
  if (evaluation.coverage) {
    json["in_view"] = {{"frames", evaluation.coverage->frames},
                       {"localised", evaluation.coverage->localized},
                       {"share", evaluation.coverage->share()}};
  }
  if (evaluation.map) add(*evaluation.map, &json);
  if (evaluation.limit) json["limit"] = toJson(*evaluation.limit);
  return json.dump(2) + "\n";
}

}  // namespace waymark::tools
