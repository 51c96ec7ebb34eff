#include "tools/print_command.h"

#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "io/settings/marker_ids.h"
#include "io/settings/slam_settings.h"
#include "io/text/text_file.h"
#include "tools/board_arguments.h"
#include "tools/exit_code.h"
#include "tools/number_arguments.h"
#include "tools/printing/board_sheet.h"
#include "tools/printing/marker_sheets.h"

namespace waymark::tools {
namespace {

// What a subcommand has to say on stdout.
using Outcome = Result<std::string>;

struct PageArguments {
  std::string page = "a4";  // as typed
  double margin_mm = printing::PageOptions{}.margin_mm;
  std::string out;
};

struct MarkerSheetArguments {
  PageArguments page;
  std::string dictionary;
  std::string ids;
  double marker_size_m = 0.0;
};

struct BoardSheetArguments {
  PageArguments page;
  BoardArguments board;
};

Result<printing::PageOptions> pageOptions(const PageArguments& arguments) {
  const auto paper = printing::paperFromText(arguments.page);
  if (!paper) {
    return Error{"--page: '" + arguments.page +
                 "' is unknown; known: a0 to a6, letter, legal, tabloid, or WIDTHxHEIGHT in mm"};
  }
  return printing::PageOptions{*paper, arguments.margin_mm};
}

Status requireOut(const PageArguments& arguments) {
  if (arguments.out.empty()) return Error{"--out is required"};
  const std::string extension = std::filesystem::path(arguments.out).extension().string();
  if (!extension.empty() && extension != ".pdf" && extension != ".PDF") {
    return Error{"--out: '" + arguments.out + "' must end in .pdf: pages are written as PDF only"};
  }
  return success();
}

// "0-9, 42", each id in its turn.
Result<std::vector<int>> idsOf(const std::string& text, const slam::Dictionary& dictionary) {
  const auto ranges = io::parseIdRanges(text);
  if (!ranges) return Error{"--ids: " + ranges.error().message};
  std::vector<int> ids;
  for (const slam::IdRange& range : *ranges) {
    if (range.last >= dictionary.size()) {
      return Error{"--ids: " + dictionary.name() + " has ids 0 to " +
                   std::to_string(dictionary.size() - 1) + ", not " + std::to_string(range.last)};
    }
    for (int id = range.first; id <= range.last; ++id) ids.push_back(id);
  }
  return ids;
}

Outcome printMarkers(const MarkerSheetArguments& arguments) {
  if (arguments.dictionary.empty()) return Error{"--dictionary is required"};
  if (const auto objection = io::validateDictionary(arguments.dictionary)) {
    return Error{"--dictionary: " + *objection};
  }
  if (arguments.ids.empty()) return Error{"--ids is required"};
  if (!(arguments.marker_size_m > 0.0)) return Error{"--marker-size is required, metres"};
  if (const Status out = requireOut(arguments.page); !out) return out.error();
  const slam::Dictionary dictionary = *slam::Dictionary::byName(arguments.dictionary);
  const Result<std::vector<int>> ids = idsOf(arguments.ids, dictionary);
  if (!ids) return ids.error();
  const Result<printing::PageOptions> page = pageOptions(arguments.page);
  if (!page) return page.error();
  const Result<std::vector<printing::PdfPage>> pages = printing::markerSheets(
      dictionary, {.ids = *ids, .marker_size_m = arguments.marker_size_m, .page = *page});
  if (!pages) return pages.error();
  const Status written =
      io::writeTextFile(arguments.page.out, printing::formatPdf(*pages, dictionary.name()));
  if (!written) return written.error();
  return std::to_string(ids->size()) + (ids->size() == 1 ? " marker, " : " markers, ") +
         std::to_string(pages->size()) + (pages->size() == 1 ? " page\n" : " pages\n");
}

// board.pdf is described in board.toml.
Outcome printBoard(const BoardSheetArguments& arguments) {
  if (const Status out = requireOut(arguments.page); !out) return out.error();
  const Result<calibration::BoardOptions> board = boardOptions(arguments.board);
  if (!board) return board.error();
  const Result<printing::PageOptions> page = pageOptions(arguments.page);
  if (!page) return page.error();
  const Result<printing::PdfPage> sheet = printing::boardSheet(*board, *page);
  if (!sheet) return sheet.error();
  const std::filesystem::path pdf = arguments.page.out;
  const std::filesystem::path description = std::filesystem::path(pdf).replace_extension(".toml");
  Status written = io::writeTextFile(description, formatBoardFile(*board));
  if (written) {
    written =
        io::writeTextFile(pdf, printing::formatPdf({*sheet}, calibration::describeBoard(*board)));
  }
  if (!written) return written.error();
  return calibration::describeBoard(*board) + "; then, with a camera or a recording of it:\n" +
         "waymark calibrate v4l2:/dev/video0 --board " + description.string() +
         " --out calibration\n";
}

void report(const Outcome& outcome, int* exit_code) {
  if (!outcome) std::fprintf(stderr, "waymark: %s\n", outcome.error().message.c_str());
  if (outcome) std::fputs(outcome->c_str(), stdout);
  *exit_code = outcome ? kDone : kBadInput;
}

void addPageArguments(CLI::App& command, PageArguments& arguments) {
  command
      .add_option("--page", arguments.page,
                  "a0 to a6, letter, legal, tabloid, or WIDTHxHEIGHT in millimetres")
      ->capture_default_str();
  command.add_option("--margin", arguments.margin_mm, "Left white at the edges, millimetres")
      ->capture_default_str()
      ->check(numberFrom(0.0, 1000.0));
  command.add_option("--out", arguments.out, "The PDF to write");
}

}  // namespace

void addPrintCommand(CLI::App& app, int* exit_code) {
  CLI::App* const print = app.add_subcommand(
      "print", "Markers as PDF, true to scale, with a ruler to check it; and calibration boards");
  const auto markers = std::make_shared<MarkerSheetArguments>();
  print->add_option("--dictionary", markers->dictionary, "Marker dictionary, e.g. APRILTAG_36h11");
  print->add_option("--ids", markers->ids, "Which ones: 0-9,42");
  print->add_option("--marker-size", markers->marker_size_m, "Side of the black square, metres")
      ->check(positiveNumber());
  addPageArguments(*print, markers->page);

  CLI::App* const board_command = print->add_subcommand(
      "board", "A board for waymark calibrate, and its description: FILE.pdf and FILE.toml");
  const auto board = std::make_shared<BoardSheetArguments>();
  addBoardArguments(*board_command, "a FILE.toml that describes one", board->board);
  addPageArguments(*board_command, board->page);
  board_command->callback([board, exit_code] { report(printBoard(*board), exit_code); });
  print->callback([print, markers, exit_code] {
    if (print->get_subcommands().empty()) report(printMarkers(*markers), exit_code);
  });
}

}  // namespace waymark::tools
