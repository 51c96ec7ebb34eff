#include "view/result_view.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string_view>
#include <utility>

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "daemon/frames/map_snapshot.h"
#include "daemon/publish/message_fields.h"
#include "daemon/publish/messages.h"
#include "daemon/publish/natural_messages.h"
#include "io/maps/map_file.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "io/trajectory.h"
#include "tools/evaluation/evaluation.h"

namespace waymark::view {
namespace {

namespace fs = std::filesystem;
using io::Json;

constexpr std::int64_t kRevision = 1;  // there is no other

// What a daemon would tell of the natural markers, which knows them from its configuration.
daemon::PrintsById printsOf(std::span<const slam::Map* const> pieces) {
  daemon::PrintsById prints;
  for (const slam::Map* const piece : pieces) {
    for (const auto& [id, marker] : piece->markers()) {
      if (!slam::isPicture(id)) continue;
      prints[id] = {.name = marker.picture, .width_m = marker.size_m, .height_m = marker.height_m};
    }
  }
  return prints;
}

void fillMap(const io::MapFile& file, ResultView* view) {
  std::vector<const slam::Map*> pieces = {&file.map};
  for (const slam::Map& piece : file.other_pieces) pieces.push_back(&piece);
  daemon::MapSnapshot snapshot;
  daemon::fillSnapshot(pieces, &snapshot);
  view->map.resize(static_cast<std::size_t>(daemon::mapPieceCount(snapshot)));
  for (std::size_t i = 0; i < view->map.size(); ++i) {
    daemon::fillMapPiece(snapshot, file.map.dictionary, kRevision, static_cast<int>(i),
                         view->map[i]);
  }
  const daemon::PrintsById prints = printsOf(pieces);
  view->natural_map.resize(static_cast<std::size_t>(daemon::naturalPieceCount(snapshot)));
  for (std::size_t i = 0; i < view->natural_map.size(); ++i) {
    daemon::fillNaturalMapPiece(snapshot, prints, kRevision, static_cast<int>(i),
                                view->natural_map[i]);
  }
}

// The frames of a poses.csv.
struct Track {
  Json poses = Json::array();
  std::map<int, io::Trajectory> trajectories;  // by piece
};

// Where the columns are that are shown.
class Columns {
 public:
  explicit Columns(const std::vector<std::string>& names) {
    for (std::size_t i = 0; i < names.size(); ++i) at_[names[i]] = i;
  }
  [[nodiscard]] std::string text(const std::vector<std::string>& row, const char* name) const {
    const auto found = at_.find(name);
    return found == at_.end() || found->second >= row.size() ? "" : row[found->second];
  }
  // Empty where the field is, or is no number.
  [[nodiscard]] std::optional<double> number(const std::vector<std::string>& row,
                                             const char* name) const {
    return io::parseDouble(text(row, name));
  }

 private:
  std::map<std::string, std::size_t> at_;
};

Result<Track> readTrack(const fs::path& file) {
  const Result<std::string> text = io::readTextFile(file);
  if (!text) return text.error();
  const std::vector<std::string_view> lines = io::split(*text, '\n');
  if (lines.empty()) return Error{file.string() + ": is empty"};
  const Columns columns(csvFields(std::string(lines.front())));
  Track track;
  for (std::size_t i = 1; i < lines.size(); ++i) {
    if (lines[i].empty()) continue;
    const std::vector<std::string> row = csvFields(std::string(lines[i]));
    const auto wrong = [&](const char* what) {
      return Error{file.string() + ":" + std::to_string(i + 1) + ": " + what};
    };
    const auto t = columns.number(row, "t");
    if (!t) return wrong("t is no number");
    const std::string source = columns.text(row, "source");
    if (source.empty()) {
      track.poses.push_back({*t, columns.text(row, "reason")});
      continue;
    }
    std::vector<double> v;
    for (const char* name : {"px", "py", "pz", "qw", "qx", "qy", "qz", "piece", "c00", "c01", "c02",
                             "c11", "c12", "c22", "markers", "rms_px"}) {
      const auto value = columns.number(row, name);
      if (!value || !std::isfinite(*value)) return wrong("a field of a pose is no number");
      v.push_back(*value);
    }
    Eigen::Matrix3d covariance;
    covariance << v[8], v[9], v[10], v[9], v[11], v[12], v[10], v[12], v[13];
    track.poses.push_back({*t, v[0], v[1], v[2], v[3], v[4], v[5], v[6], v[7],
                           daemon::positionSigma(covariance), v[14], v[15], source});
    slam::Transform T_w_c;
    T_w_c.R = Eigen::Quaterniond(v[3], v[4], v[5], v[6]).normalized().toRotationMatrix();
    T_w_c.p = {v[0], v[1], v[2]};
    track.trajectories[static_cast<int>(v[7])].push_back({std::llround(1e9 * *t), T_w_c});
  }
  return track;
}

// Of the piece with the most frames, against the truth.
struct Comparison {
  Json errors;  // null: no two poses share a time
  slam::Transform T_truth_est;
  int piece = 0;
};

Comparison compare(const std::string& name, const Track& track, io::Trajectory truth) {
  const auto most = std::ranges::max_element(track.trajectories, {},
                                             [](const auto& entry) { return entry.second.size(); });
  if (most == track.trajectories.end()) return {};
  const tools::TrajectoryOptions options;
  const auto errors = tools::compareTrajectories(truth, most->second, options);
  if (!errors) return {};
  tools::sortByTime(&truth);
  Comparison compared{.errors = {{"name", name},
                                 {"rms_m", errors->ate_m.rms},
                                 {"median_m", errors->ate_m.median},
                                 {"max_m", errors->ate_m.max},
                                 {"points", Json::array()}},
                      .T_truth_est = errors->T_truth_est,
                      .piece = most->first};
  for (const io::StampedPose& pose : most->second) {
    const io::StampedPose* const near =
        tools::nearestPose(truth, pose.time_ns, options.tolerance_ns);
    if (near == nullptr) continue;
    const Eigen::Vector3d off = errors->T_truth_est * pose.T_w_c.p - near->T_w_c.p;
    compared.errors["points"].push_back({1e-9 * static_cast<double>(pose.time_ns), off.norm()});
  }
  return compared;
}

}  // namespace

std::vector<std::string> csvFields(const std::string& line) {
  std::vector<std::string> fields(1);
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted && c == '"' && i + 1 < line.size() && line[i + 1] == '"') {
      fields.back() += line[++i];
    } else if (c == '"') {
      quoted = !quoted;
    } else if (c == ',' && !quoted) {
      fields.emplace_back();
    } else if (c != '\r') {
      fields.back() += c;
    }
  }
  return fields;
}

Result<ResultView> readResultView(const fs::path& directory, const fs::path& truth_file) {
  const Result<io::MapFile> map = io::readMap(directory / "map.json");
  if (!map) return map.error();
  ResultView view{.map = {}, .natural_map = {}, .result = {{"type", "result"}}};
  fillMap(*map, &view);
  view.result["name"] = fs::absolute(directory).lexically_normal().string();
  if (const Result<std::string> stats = io::readTextFile(directory / "stats.json")) {
    const Result<Json> parsed = io::parseJson(*stats, "stats.json");
    if (parsed && parsed->contains("verdict")) view.result["verdict"] = (*parsed)["verdict"];
  }
  io::Trajectory truth;
  if (!truth_file.empty()) {
    Result<io::Trajectory> read = io::readTrajectory(truth_file);
    if (!read) return read.error();
    truth = std::move(read).value();
  }
  view.result["tracks"] = Json::array();
  view.result["errors"] = Json::array();
  view.result["truth"] = Json::array();
  struct Source {
    const char* name;
    const char* file;
  };
  for (const Source& source : {Source{"live", "poses.csv"}, Source{"final", "poses_final.csv"}}) {
    const Result<Track> track = readTrack(directory / source.file);
    if (!track) return track.error();
    view.result["tracks"].push_back({{"name", source.name}, {"poses", track->poses}});
    if (truth.empty()) continue;
    const Comparison compared = compare(source.name, *track, truth);
    if (compared.errors.is_null()) {
      return Error{truth_file.string() + ": has no pose at the time of one in " +
                   (directory / source.file).string()};
    }
    view.result["errors"].push_back(compared.errors);
    // In the world of the final track, which comes last.
    view.result["truth"].clear();
    const slam::Transform T_est_truth = compared.T_truth_est.inverse();
    for (const io::StampedPose& pose : truth) {
      const Eigen::Vector3d p = T_est_truth * pose.T_w_c.p;
      view.result["truth"].push_back(
          {1e-9 * static_cast<double>(pose.time_ns), p.x(), p.y(), p.z(), compared.piece});
    }
  }
  return view;
}

}  // namespace waymark::view
