#include "tools/map_command.h"

#include <algorithm>
#include <cstdio>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <CLI/CLI.hpp>

#include "io/maps/aruco_map.h"
#include "io/maps/map_file.h"
#include "io/maps/ply_map.h"
#include "io/maps/posed_markers.h"
#include "io/maps/tagslam_map.h"
#include "io/maps/wpilib_map.h"
#include "io/settings/marker_ids.h"
#include "io/settings/slam_settings.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "io/trajectory.h"
#include "slam/options.h"
#include "tools/exit_code.h"
#include "tools/maps/map_align.h"
#include "tools/maps/map_info.h"
#include "tools/maps/map_merge.h"
#include "tools/number_arguments.h"

namespace waymark::tools {
namespace {

struct AlignArguments {
  std::string map;
  std::string floor;
  std::string up;
  std::optional<int> origin;
  std::optional<int> xy;
  std::string out;
};

// What a subcommand has to say on stdout.
using Outcome = Result<std::string>;

struct InfoArguments {
  std::string map;
  bool markers = false;
};

struct ExportArguments {
  std::string map;
  std::string format;
  std::optional<int> piece;
  std::string out;
};

struct ImportArguments {
  std::string file;
  std::string format;
  std::string dictionary;
  std::optional<double> size_m;
  std::string out;
};

struct MergeArguments {
  std::vector<std::string> files;  // the last one is written
  MergeOptions options;
  bool no_global = false;
};

Outcome info(const InfoArguments& arguments) {
  const Result<io::MapFile> file = io::readMap(arguments.map);
  if (!file) return file.error();
  return mapInfo(*file, arguments.markers);
}

// Of a map in pieces one world goes into what knows of no pieces.
void tellOfOtherPieces(const std::string& name, const io::MapFile& file) {
  if (file.other_pieces.empty()) return;
  std::fprintf(stderr,
               "waymark: %s: has %zu pieces, each with a world of its own; this is piece %d\n",
               name.c_str(), 1 + file.other_pieces.size(), file.map.piece);
}

io::Trajectory keyframePoses(const slam::Map& map) {
  io::Trajectory trajectory;
  for (const auto& [id, keyframe] : map.keyframes()) {
    trajectory.push_back({keyframe.monotonic_ns, keyframe.T_w_c});
  }
  return trajectory;
}

std::string exported(const io::MapFile& file, const std::string& format) {
  io::PosedMarkers markers = io::posedMarkers(file.map);
  markers.field = file.field;
  if (format == "aruco") return io::formatArucoMap(markers);
  if (format == "tagslam") return io::formatTagslamMap(markers);
  if (format == "wpilib") return io::formatWpilibMap(markers);
  if (format == "ply") return io::formatPlyMap(markers);
  return io::formatTrajectory(keyframePoses(file.map));  // tum
}

// Puts the piece in the place of the file's first one.
Status choosePiece(const std::string& name, int piece, io::MapFile* file) {
  if (file->map.piece == piece) return success();
  const auto found = std::ranges::find(file->other_pieces, piece, &slam::Map::piece);
  if (found == file->other_pieces.end()) {
    return Error{name + ": has no piece " + std::to_string(piece)};
  }
  std::swap(file->map, *found);
  return success();
}

Outcome exportMap(const ExportArguments& arguments) {
  Result<io::MapFile> file = io::readMap(arguments.map);
  if (!file) return file.error();
  if (arguments.piece) {
    const Status chosen = choosePiece(arguments.map, *arguments.piece, &*file);
    if (!chosen) return chosen.error();
  }
  if (arguments.format == "tum" && file->map.keyframes().empty()) {
    return Error{arguments.map + ": has no keyframes, and so no poses"};
  }
  if (!arguments.piece) tellOfOtherPieces(arguments.map, *file);
  const Status written = io::writeTextFile(arguments.out, exported(*file, arguments.format));
  if (!written) return written.error();
  return std::string();
}

Result<io::PosedMarkers> imported(const ImportArguments& arguments) {
  const Result<std::string> text = io::readTextFile(arguments.file);
  if (!text) return text.error();
  if (arguments.format == "aruco") return io::parseArucoMap(*text, arguments.file);
  if (arguments.format == "tagslam") return io::parseTagslamMap(*text, arguments.file);
  return io::parseWpilibMap(*text, arguments.file);
}

// What the file does not say comes from the command line; both may say it, but not two things.
Status complete(const ImportArguments& arguments, io::PosedMarkers* markers) {
  if (!arguments.dictionary.empty()) {
    if (const auto objection = io::validateDictionary(arguments.dictionary)) {
      return Error{"--dictionary: " + *objection};
    }
    if (!markers->dictionary.empty() && markers->dictionary != arguments.dictionary) {
      return Error{arguments.file + ": is of " + markers->dictionary + ", not of " +
                   arguments.dictionary};
    }
    markers->dictionary = arguments.dictionary;
  }
  if (markers->dictionary.empty()) {
    return Error{arguments.file + ": does not say which dictionary; give --dictionary"};
  }
  for (io::PosedMarker& marker : markers->markers) {
    if (marker.size_m == 0.0) marker.size_m = arguments.size_m.value_or(0.0);
  }
  return success();
}

Outcome importMap(const ImportArguments& arguments) {
  Result<io::PosedMarkers> markers = imported(arguments);
  if (!markers) return markers.error();
  if (const Status whole = complete(arguments, &*markers); !whole) return whole.error();
  const Result<slam::Map> map = io::mapOf(*markers, arguments.file);
  if (!map) return map.error();
  const Status written =
      io::writeTextFile(arguments.out, io::formatMap(*map, std::nullopt, 0.0, markers->field));
  if (!written) return written.error();
  return std::to_string(map->markers().size()) + " markers\n";
}

std::string listed(const std::vector<int>& ids) {
  std::string text;
  for (const int id : ids) text += " " + std::to_string(id);
  return text;
}

std::string mergeText(const std::string& file, const MergeReport& report) {
  std::string text = file + ": " + std::to_string(report.agreeing.size()) +
                     " shared markers agree, " + io::fixed(1000.0 * report.rms_m, 2) + " mm rms; " +
                     std::to_string(report.added.size()) + " markers are new\n";
  if (report.bridged > 0) {
    text +=
        file + ": joins " + std::to_string(report.bridged) + " of the pieces so far to others\n";
  }
  if (report.pieces_apart > 0) {
    text += file + ": " + std::to_string(report.pieces_apart) + " of its " +
            std::to_string(report.pieces_joined + report.pieces_apart) +
            " pieces share too little with the others, and stay pieces of their own\n";
  }
  if (!report.disagreeing.empty()) {
    text +=
        file + ": these disagree and are left where they were:" + listed(report.disagreeing) + "\n";
  }
  for (const std::string& warning : report.warnings) text += file + ": " + warning + "\n";
  return text;
}

// The first piece of it.
std::string optimize(io::MapFile* merged) {
  if (merged->map.keyframes().empty()) return {};
  const std::string before = io::fixed(reprojectionFit(*merged).rms_px, 3);
  const slam::Options options;
  (void)slam::optimizeGlobally(&merged->map, options.markers, options.global_optimization);
  return "optimized: " + before + " px rms before, " +
         io::fixed(reprojectionFit(*merged).rms_px, 3) + " px after\n";
}

std::string optimizeAll(io::MapFile* merged) {
  std::string text = optimize(merged);
  for (slam::Map& piece : merged->other_pieces) {
    std::swap(merged->map, piece);
    text += "piece " + std::to_string(merged->map.piece) + ", " + optimize(merged);
    std::swap(merged->map, piece);
  }
  return text;
}

Outcome merge(const MergeArguments& arguments) {
  if (arguments.files.size() < 3) return Error{"map merge needs two maps and a file to write"};
  Result<io::MapFile> merged = io::readMap(arguments.files.front());
  if (!merged) return merged.error();
  std::string text;
  for (std::size_t i = 1; i + 1 < arguments.files.size(); ++i) {
    const std::string& name = arguments.files[i];
    const Result<io::MapFile> next = io::readMap(name);
    if (!next) return next.error();
    const Result<MergeReport> report = mergeMaps(&*merged, *next, arguments.options);
    if (!report) return Error{name + ": " + report.error().message};
    text += mergeText(name, *report);
  }
  if (!arguments.no_global) text += optimizeAll(&*merged);
  const Status written = io::writeTextFile(arguments.files.back(), io::formatMap(*merged));
  if (!written) return written.error();
  return text;
}

Result<AlignOptions> optionsOf(const AlignArguments& arguments) {
  AlignOptions options;
  options.origin = arguments.origin;
  options.xy = arguments.xy;
  const auto parse = [](const std::string& name, const std::string& text,
                        std::vector<slam::IdRange>* ids) -> Status {
    if (text.empty()) return success();
    const auto ranges = io::parseIdRanges(text);
    if (!ranges) return Error{name + ": " + ranges.error().message};
    *ids = *ranges;
    return success();
  };
  if (const Status read = parse("--floor", arguments.floor, &options.floor); !read) {
    return read.error();
  }
  if (const Status read = parse("--up", arguments.up, &options.up); !read) return read.error();
  if (std::string reason = options.invalidReason(); !reason.empty()) return Error{reason};
  return options;
}

// The piece that has any of them.
slam::Map* pieceWith(const std::vector<slam::IdRange>& ids, io::MapFile* file) {
  const auto has = [&](const slam::Map& map) {
    return std::ranges::any_of(map.markers(), [&](const auto& entry) {
      const auto contains = [&](const slam::IdRange& range) { return range.contains(entry.first); };
      return entry.second.T_w_m && std::ranges::any_of(ids, contains);
    });
  };
  if (has(file->map)) return &file->map;
  const auto found = std::ranges::find_if(file->other_pieces, has);
  return found == file->other_pieces.end() ? &file->map : &*found;
}

Outcome align(const AlignArguments& arguments) {
  const Result<AlignOptions> options = optionsOf(arguments);
  if (!options) return options.error();
  Result<io::MapFile> file = io::readMap(arguments.map);
  if (!file) return file.error();
  slam::Map* const piece = pieceWith(options->named(), &*file);
  const std::string in_piece =
      file->other_pieces.empty() ? std::string() : "piece " + std::to_string(piece->piece) + ": ";
  const Result<AlignReport> report = alignMap(piece, *options);
  if (!report) return Error{arguments.map + ": " + in_piece + report.error().message};
  const Status written = io::writeTextFile(arguments.out, io::formatMap(*file));
  if (!written) return written.error();
  return in_piece + alignText(*report);
}

// Runs a subcommand with its arguments when it was chosen.
template <typename Arguments>
void onCall(CLI::App* command, const std::shared_ptr<Arguments>& arguments,
            Outcome (*run)(const Arguments&), int* exit_code) {
  command->callback([arguments, run, exit_code] {
    const Outcome outcome = run(*arguments);
    if (!outcome) std::fprintf(stderr, "waymark: %s\n", outcome.error().message.c_str());
    if (outcome) std::fputs(outcome->c_str(), stdout);
    *exit_code = outcome ? kDone : kBadInput;
  });
}

void addInfo(CLI::App& map, int* exit_code) {
  CLI::App* command = map.add_subcommand("info", "Check a map and say what is in it");
  const auto arguments = std::make_shared<InfoArguments>();
  command->add_option("map", arguments->map, "A map.json")->required();
  command->add_flag("--markers", arguments->markers, "A line for each marker, too");
  onCall(command, arguments, info, exit_code);
}

void addExport(CLI::App& map, int* exit_code) {
  CLI::App* command = map.add_subcommand("export", "Write a map in another program's format");
  const auto arguments = std::make_shared<ExportArguments>();
  command->add_option("map", arguments->map, "A map.json")->required();
  command
      ->add_option("--format", arguments->format,
                   "aruco (ArUco and UcoSLAM marker map), tagslam, wpilib (field layout), ply "
                   "(markers as faces), tum (poses of the keyframes)")
      ->required()
      ->check(CLI::IsMember({"aruco", "tagslam", "wpilib", "ply", "tum"}));
  command->add_option("--piece", arguments->piece,
                      "Which piece of a map in pieces; the first one in the file without");
  command->add_option("out", arguments->out, "The file to write")->required();
  onCall(command, arguments, exportMap, exit_code);
}

void addImport(CLI::App& map, int* exit_code) {
  CLI::App* command =
      map.add_subcommand("import", "Make a map, without keyframes, of another program's");
  const auto arguments = std::make_shared<ImportArguments>();
  command->add_option("file", arguments->file, "The file to read")->required();
  command->add_option("--format", arguments->format, "aruco, tagslam or wpilib")
      ->required()
      ->check(CLI::IsMember({"aruco", "tagslam", "wpilib"}));
  command->add_option("--dictionary", arguments->dictionary,
                      "Marker dictionary, where the file does not say");
  command
      ->add_option("--size", arguments->size_m,
                   "Side of the markers, metres, where the file does not say")
      ->check(positiveNumber());
  command->add_option("out", arguments->out, "The map.json to write")->required();
  onCall(command, arguments, importMap, exit_code);
}

void addMerge(CLI::App& map, int* exit_code) {
  CLI::App* command = map.add_subcommand("merge", "Join maps by the markers they share");
  const auto arguments = std::make_shared<MergeArguments>();
  command
      ->add_option("files", arguments->files,
                   "Two maps or more, the first one's world is kept; then the file to write")
      ->required();
  command
      ->add_option("--tolerance", arguments->options.tolerance_m,
                   "Corners of a shared marker may be this far apart, metres")
      ->capture_default_str()
      ->check(numberFrom(1e-6, 1e3));
  command
      ->add_option("--min-shared", arguments->options.min_agreeing,
                   "Shared markers that must agree")
      ->capture_default_str()
      ->check(wholeNumberFrom(2, 1'000'000));
  command->add_flag("--no-global", arguments->no_global, "No optimization of the merged map");
  onCall(command, arguments, merge, exit_code);
}

void addAlign(CLI::App& map, int* exit_code) {
  CLI::App* command =
      map.add_subcommand("align", "Move a map into a world with floor, vertical and origin");
  const auto arguments = std::make_shared<AlignArguments>();
  command->add_option("map", arguments->map, "A map.json")->required();
  command->add_option("--floor", arguments->floor,
                      "Markers that lie on the floor, face up: \"3, 7-9\"; z is 0 there, and up");
  command->add_option("--up", arguments->up,
                      "Markers that hang upright: z is up as their y axes are");
  command
      ->add_option("--origin", arguments->origin,
                   "The marker whose centre is the origin, or, with --floor, is above it")
      ->check(wholeNumberFrom(0, 1'000'000));
  command
      ->add_option("--xy", arguments->xy,
                   "The marker that the x axis points to, from the one of --origin")
      ->check(wholeNumberFrom(0, 1'000'000));
  command->add_option("--out", arguments->out, "The file to write; may be the map's own")
      ->required();
  onCall(command, arguments, align, exit_code);
}

}  // namespace

void addMapCommand(CLI::App& app, int* exit_code) {
  CLI::App* map = app.add_subcommand("map", "Look into maps, translate, join and align them");
  map->require_subcommand(1);
  addInfo(*map, exit_code);
  addExport(*map, exit_code);
  addImport(*map, exit_code);
  addMerge(*map, exit_code);
  addAlign(*map, exit_code);
}

}  // namespace waymark::tools
