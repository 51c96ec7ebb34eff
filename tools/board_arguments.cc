#include "tools/board_arguments.h"

#include <vector>

#include <CLI/CLI.hpp>

#include "io/settings/settings_file.h"
#include "io/settings/slam_settings.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"

namespace waymark::tools {
namespace {

using calibration::BoardKind;
using calibration::BoardOptions;

Result<BoardOptions> readBoardFile(const std::filesystem::path& file) {
  using namespace io;
  constexpr int kMaxIds = 1'000'000;
  const Result<std::string> text = readTextFile(file);
  if (!text) return text.error();
  BoardOptions options;
  options.marker_size_m = 0.0;
  options.dictionary.clear();
  const std::vector<Setting> settings = {
      required(choiceSetting<BoardKind>("board.kind", options.kind,
                                        {{"charuco", BoardKind::kCharuco},
                                         {"markers", BoardKind::kMarkers},
                                         {"chessboard", BoardKind::kChessboard}})),
      required(integerSetting("board.columns", options.columns, 1, 1000)),
      required(integerSetting("board.rows", options.rows, 1, 1000)),
      required(numberSetting("board.square_size_m", options.square_size_m, 1e-4, 100.0, "m")),
      numberSetting("board.marker_size_m", options.marker_size_m, 1e-4, 100.0, "m"),
      textSetting("board.dictionary", options.dictionary, validateDictionary),
      integerSetting("board.first_id", options.first_id, 0, kMaxIds),
  };
  if (const Status read = readSettings(*text, file, settings); !read) return read.error();
  if (options.kind == BoardKind::kChessboard) return options;
  if (options.marker_size_m == 0.0)
    return Error{file.string() + ": board.marker_size_m is missing"};
  if (options.dictionary.empty()) return Error{file.string() + ": board.dictionary is missing"};
  return options;
}

}  // namespace

void addBoardArguments(CLI::App& command, const std::string& files, BoardArguments& arguments) {
  const BoardOptions defaults;
  command
      .add_option("--board", arguments.board,
                  "charuco (a chessboard with markers in its white squares), markers (a grid of "
                  "markers), chessboard (a plain one), or " +
                      files)
      ->capture_default_str();
  command.add_option("--columns", arguments.columns,
                     "Squares, or markers, side by side; else " + std::to_string(defaults.columns));
  command.add_option(
      "--rows", arguments.rows,
      "Squares, or markers, one above the other; else " + std::to_string(defaults.rows));
  command.add_option("--square-size", arguments.square_size_m,
                     "Side of a square, or from one marker to the next, metres; else " +
                         io::roundTrip(defaults.square_size_m));
  command.add_option(
      "--marker-size", arguments.marker_size_m,
      "Side of the markers' black squares, metres; else " + io::roundTrip(defaults.marker_size_m));
  command.add_option("--dictionary", arguments.dictionary,
                     "Marker dictionary; else " + defaults.dictionary);
  command.add_option("--first-id", arguments.first_id,
                     "Id of the top-left marker; the others count on, row by row; else 0");
}

Result<BoardOptions> boardOptions(const BoardArguments& arguments) {
  BoardOptions options;
  if (arguments.board == "markers") {
    options.kind = BoardKind::kMarkers;
  } else if (arguments.board == "chessboard") {
    options.kind = BoardKind::kChessboard;
  } else if (arguments.board != "charuco") {
    Result<BoardOptions> read = readBoardFile(arguments.board);
    if (!read) return read.error();
    options = std::move(read).value();
  }
  const bool of_markers =
      arguments.marker_size_m || arguments.first_id || !arguments.dictionary.empty();
  if (options.kind == BoardKind::kChessboard && of_markers) {
    return Error{"--board " + arguments.board + ": a chessboard has no markers"};
  }
  options.columns = arguments.columns.value_or(options.columns);
  options.rows = arguments.rows.value_or(options.rows);
  options.square_size_m = arguments.square_size_m.value_or(options.square_size_m);
  options.marker_size_m = arguments.marker_size_m.value_or(options.marker_size_m);
  options.first_id = arguments.first_id.value_or(options.first_id);
  if (!arguments.dictionary.empty()) {
    if (const auto objection = io::validateDictionary(arguments.dictionary)) {
      return Error{"--dictionary: " + *objection};
    }
    options.dictionary = arguments.dictionary;
  }
  if (const std::string reason = options.invalidReason(); !reason.empty()) {
    return Error{"--board " + arguments.board + ": " + reason};
  }
  return options;
}

std::string formatBoardFile(const BoardOptions& options) {
  const bool charuco = options.kind == BoardKind::kCharuco;
  const bool chessboard = options.kind == BoardKind::kChessboard;
  std::string text =
      "# A calibration board, for waymark calibrate --board. Where the printed ruler ";
  text += chessboard ? "is not as long as it\n# says, correct the size here.\n[board]\n"
                     : "is not as long as it\n# says, correct both sizes here.\n[board]\n";
  text += std::string("kind = \"") +
          (chessboard ? "chessboard" : (charuco ? "charuco" : "markers")) + "\"\n";
  text += "columns = " + std::to_string(options.columns) + "\n";
  text += "rows = " + std::to_string(options.rows) + "\n";
  text += std::string("# ") +
          (charuco || chessboard ? "Side of a square" : "From one marker to the next") +
          ", metres.\nsquare_size_m = " + io::roundTrip(options.square_size_m) + "\n";
  if (chessboard) return text;
  text += "# Side of the markers' black squares, metres.\nmarker_size_m = " +
          io::roundTrip(options.marker_size_m) + "\n";
  text += "dictionary = \"" + options.dictionary + "\"\n";
  return text + "first_id = " + std::to_string(options.first_id) + "\n";
}

}  // namespace waymark::tools
