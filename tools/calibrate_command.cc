#include "tools/calibrate_command.h"

#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include <CLI/CLI.hpp>

#include "base/clock.h"
#include "capture/open_source.h"
#include "daemon/configuration.h"
#include "daemon/control/stop_signal.h"
#include "daemon/publish/lcm_link.h"
#include "io/maps/marker_corners.h"
#include "io/settings/slam_settings.h"
#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "tools/board_arguments.h"
#include "tools/calibration/board.h"
#include "tools/calibration/calibrator.h"
#include "tools/calibration/guide.h"
#include "tools/calibration/view_collector.h"
#include "tools/calibration_broadcast.h"
#include "tools/calibration_output.h"
#include "tools/exit_code.h"
#include "tools/number_arguments.h"
#include "tools/progress_bar.h"

namespace waymark::tools {
namespace {

using std::chrono_literals::operator""ms;

struct CalibrateArguments {
  std::string source;
  BoardArguments board;
  calibration::Lens lens = calibration::Lens::kPlumbBob;
  std::string out;
  std::optional<double> fps;
  std::optional<double> duration_s;
  bool realtime = false;
  bool quiet = false;
  std::string url;  // empty: the usual one, for cameras
  std::string channel_prefix = daemon::Configuration::Publish{}.channel_prefix;
};

struct NamedBoard {
  calibration::Board board;
  std::string description;
};

// A map or a layout, with all its markers.
Result<NamedBoard> boardOfLayout(const BoardArguments& arguments) {
  if (arguments.columns || arguments.rows || arguments.square_size_m || arguments.marker_size_m ||
      arguments.first_id) {
    return Error{"--board " + arguments.board + ": says itself where its markers are"};
  }
  if (arguments.dictionary.empty()) return Error{"--dictionary is required with a layout"};
  if (const auto objection = io::validateDictionary(arguments.dictionary)) {
    return Error{"--dictionary: " + *objection};
  }
  const auto corners = io::readMarkerCorners(arguments.board);
  if (!corners) return corners.error();
  std::vector<calibration::BoardMarker> markers;
  for (const io::MarkerCorners& marker : *corners) markers.push_back({marker.id, marker.corners});
  auto board = calibration::Board::fromLayout(arguments.dictionary, std::move(markers));
  if (!board) return Error{arguments.board + ": " + board.error().message};
  return NamedBoard{std::move(board).value(), arguments.board};
}

Result<NamedBoard> boardOf(const BoardArguments& arguments) {
  if (arguments.board.ends_with(".json")) return boardOfLayout(arguments);
  const Result<calibration::BoardOptions> options = boardOptions(arguments);
  if (!options) return options.error();
  return NamedBoard{calibration::Board(*options), calibration::describeBoard(*options)};
}

// Until the recording ends, the time is over, or somebody says stop.
class Ending {
 public:
  // Before the source is opened: its threads must not take the signal.
  explicit Ending(const CalibrateArguments& arguments) {
    if (capture::isCamera(arguments.source) || arguments.realtime) stop_.emplace();
  }
  void begin(std::optional<double> duration_s) {
    if (duration_s) end_ns_ = monotonicNs() + std::llround(1e9 * *duration_s);
  }
  [[nodiscard]] bool now() const {
    return (stop_ && stop_->pending()) || (end_ns_ && monotonicNs() >= *end_ns_);
  }

 private:
  std::optional<daemon::StopSignal> stop_;
  std::optional<std::int64_t> end_ns_;
};

// Frames, and what is made of each.
class Session {
 public:
  Session(const calibration::Board& board, const capture::StreamInfo& info)
      : detector_(board, calibration::roughCalibration(info.width, info.height)),
        collector_(board, info.width, info.height),
        guide_(board, info.width, info.height) {}

  void look(const capture::Frame& frame, std::string name, CalibrationRun* run) {
    ++run->frames;
    std::optional<calibration::BoardView> board_view = detector_.detect(frame.image());
    guide_.add(board_view ? &*board_view : nullptr);
    const std::int64_t now_ns = monotonicNs();
    if (board_view) ++run->with_board;
    if (board_view) collector_.offer(std::move(name), *board_view, frame.image());
    if (!broadcast_ || !broadcast_->due(now_ns)) return;
    broadcast_->send(frame, board_view ? &*board_view : nullptr, collector_,
                     guide_.advice(collector_), *run, now_ns);
  }
  // From now on others hear of it, too.
  void tell(const std::string& url, const std::string& channel_prefix) {
    broadcast_.emplace(url, channel_prefix);
  }

  [[nodiscard]] std::string progressText() const {
    return std::to_string(collector_.count()) + " views, " +
           io::fixed(100.0 * collector_.coverage().share(), 0) + " % covered. " +
           guide_.advice(collector_).text;
  }
  [[nodiscard]] std::vector<calibration::View> take() && { return std::move(collector_).take(); }

 private:
  calibration::BoardDetector detector_;
  calibration::ViewCollector collector_;
  calibration::Guide guide_;
  std::optional<CalibrationBroadcast> broadcast_;
};

Result<std::vector<calibration::View>> collect(const CalibrateArguments& arguments,
                                               const calibration::Board& board,
                                               capture::FrameSource& source, Ending ending,
                                               CalibrationRun* run) {
  const capture::StreamInfo& info = source.info();
  Session session(board, info);
  const std::string url =
      arguments.url.empty() && info.live ? daemon::Configuration::Publish{}.url : arguments.url;
  if (!url.empty()) session.tell(url, arguments.channel_prefix);
  ending.begin(arguments.duration_s);
  ProgressBar bar(info.frame_count >= 0 ? std::optional(info.frame_count) : std::nullopt,
                  /*wanted=*/!arguments.quiet);
  while (!ending.now()) {
    capture::ReadResult read = source.read(100ms);
    if (Error* error = std::get_if<Error>(&read)) return std::move(*error);
    if (std::holds_alternative<capture::EndOfStream>(read)) break;
    if (std::holds_alternative<capture::TimedOut>(read)) continue;
    const capture::FramePtr frame = std::get<capture::FramePtr>(std::move(read));
    session.look(*frame, source.frameName(frame->stamp().sequence), run);
    bar.update(static_cast<std::int64_t>(run->frames), [&] { return session.progressText(); });
  }
  if (run->with_board == 0) {
    return Error{arguments.source + ": the board is in none of " + std::to_string(run->frames) +
                 " frames (" + run->board + ")"};
  }
  return std::move(session).take();
}

Status calibrate(const CalibrateArguments& arguments) {
  if (!arguments.url.empty() && !daemon::multicastAddress(arguments.url)) {
    return Error{"--url: not a multicast address: " + arguments.url};
  }
  const Result<NamedBoard> named = boardOf(arguments.board);
  if (!named) return named.error();
  Ending ending(arguments);
  const auto source =
      capture::openSource(arguments.source, {.fps = arguments.fps, .realtime = arguments.realtime});
  if (!source) return source.error();
  Result<io::OutputDirectory> output = io::OutputDirectory::open(arguments.out);
  if (!output) return output.error();
  CalibrationRun run{.source = (*source)->info().description, .board = named->description};
  if (!arguments.quiet) std::fprintf(stderr, "%s; %s\n", run.source.c_str(), run.board.c_str());
  auto views = collect(arguments, named->board, **source, std::move(ending), &run);
  if (!views) return views.error();
  const auto report =
      calibration::calibrateCamera(named->board, std::move(views).value(), arguments.lens);
  if (!report) return Error{arguments.source + ": " + report.error().message};
  addCalibrationFiles(run, *report, &*output);
  if (Status written = output->commit(); !written) return written;
  if (!arguments.quiet) std::fputs(calibrationText(run, *report).c_str(), stdout);
  return success();
}

void addOptions(CLI::App* command, CalibrateArguments* a) {
  using calibration::Lens;
  const std::map<std::string, Lens> lenses = {{"plumb_bob", Lens::kPlumbBob},
                                              {"rational", Lens::kRational},
                                              {"equidistant", Lens::kEquidistant}};
  command
      ->add_option("source", a->source,
                   "A camera, a video file or a directory of images that show the board from many "
                   "sides; a camera until Ctrl-C")
      ->required();
  addBoardArguments(*command,
                    "the FILE.toml that waymark print board wrote, or a flat layout or map of "
                    "markers, FILE.json",
                    a->board);
  command
      ->add_option("--model", a->lens,
                   "plumb_bob (most lenses; the default), rational (wide ones) or equidistant "
                   "(fisheyes)")
      ->transform(CLI::Transformer(lenses))
      ->option_text("plumb_bob|rational|equidistant");
  command
      ->add_option("--out", a->out,
                   "Directory for calib.yml (OpenCV), camera_info.yaml (ROS), calibration.json and "
                   "calibration.png")
      ->required();
  command->add_option("--fps", a->fps, "Frame rate, instead of the recording's own, Hz")
      ->check(frameRate());
  command->add_option("--duration", a->duration_s, "Look at a camera for so long, seconds")
      ->check(duration());
  command->add_flag("--realtime", a->realtime,
                    "Play a recording as if a camera were taking it now");
  command->add_option(
      "--url", a->url,
      "LCM URL at which waymark-view hears what is still needed; else the usual one, "
      "for cameras");
  command->add_option("--channel-prefix", a->channel_prefix, "Channels begin with this")
      ->capture_default_str();
  command->add_flag("--quiet", a->quiet, "Say nothing but errors");
}

}  // namespace

void addCalibrateCommand(CLI::App& app, int* exit_code) {
  CLI::App* const command = app.add_subcommand(
      "calibrate", "Calibrate a camera from views of a board that waymark print board has made");
  const auto arguments = std::make_shared<CalibrateArguments>();
  addOptions(command, arguments.get());
  command->callback([arguments, exit_code] {
    const Status status = calibrate(*arguments);
    if (!status) std::fprintf(stderr, "waymark: %s\n", status.error().message.c_str());
    *exit_code = status ? kDone : kBadInput;
  });
}

}  // namespace waymark::tools
