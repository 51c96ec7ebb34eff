// The command line's say about a calibration board, and the file in which it is kept.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include <CLI/App.hpp>

#include "base/result.h"
#include "tools/calibration/board.h"

namespace waymark::tools {

struct BoardArguments {
  std::string board = "charuco";  // charuco, markers, or a file
  std::optional<int> columns;
  std::optional<int> rows;
  std::optional<double> square_size_m;
  std::optional<double> marker_size_m;
  std::string dictionary;  // empty: the file's, or the default
  std::optional<int> first_id;
};

// `files`: what else --board may be, for its help. `arguments` must live as long as `command`.
void addBoardArguments(CLI::App& command, const std::string& files, BoardArguments& arguments);

// From the board file, where --board names one, and the command line, which wins.
[[nodiscard]] Result<calibration::BoardOptions> boardOptions(const BoardArguments& arguments);

// TOML, section [board]: kind, columns, rows, square_size_m, marker_size_m, dictionary, first_id.
[[nodiscard]] std::string formatBoardFile(const calibration::BoardOptions& options);

}  // namespace waymark::tools
