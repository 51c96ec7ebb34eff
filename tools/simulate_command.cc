#include "tools/simulate_command.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include <CLI/CLI.hpp>

#include "simulator/recording.h"
#include "simulator/simulation.h"
#include "tools/exit_code.h"
#include "tools/progress_bar.h"

namespace waymark::tools {
namespace {

struct Arguments {
  simulator::Options options;
  simulator::RecordingOptions recording;
  bool truth_only = false;
  bool quiet = false;
  // As typed.
  std::string out;
  std::string size;
  std::vector<std::string> blackouts;
  std::vector<std::string> dimmings;
  std::string moved;
  std::string refocus;
};

// "1:2.5:3" to its numbers; separators are ':', ',' and 'x'. Empty unless there are exactly
// `count`.
std::optional<std::vector<double>> numbers(std::string_view text, std::size_t count) {
  std::vector<double> values;
  while (values.size() < count) {
    double value = 0.0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc()) return std::nullopt;
    values.push_back(value);
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
    if (text.empty()) break;
    if (std::string_view(":,x").find(text.front()) == std::string_view::npos) return std::nullopt;
    text.remove_prefix(1);
    if (text.empty()) return std::nullopt;
  }
  if (values.size() != count || !text.empty()) return std::nullopt;
  return values;
}

// The number as an int, where it is one.
std::optional<int> whole(double value) {
  constexpr double kLargest = 1e9;
  if (!(std::abs(value) <= kLargest) || value != std::floor(value)) return std::nullopt;
  return static_cast<int>(value);
}

Error malformed(const char* option, const std::string& text, const char* form) {
  return Error{std::string(option) + ": '" + text + "' is not of the form " + form};
}

// The options that are more than one number.
Status parseCompound(Arguments* a) {
  if (!a->size.empty()) {
    const auto v = numbers(a->size, 2);
    const auto width = v ? whole((*v)[0]) : std::nullopt;
    const auto height = v ? whole((*v)[1]) : std::nullopt;
    if (!width || !height) return malformed("--size", a->size, "WIDTHxHEIGHT");
    a->options.size = {*width, *height};
  }
  for (const std::string& text : a->blackouts) {
    const auto v = numbers(text, 2);
    if (!v) return malformed("--blackout", text, "BEGIN:END");
    a->options.blackouts.push_back({(*v)[0], (*v)[1]});
  }
  for (const std::string& text : a->dimmings) {
    const auto v = numbers(text, 3);
    if (!v) return malformed("--dim", text, "BEGIN:END:FACTOR");
    a->options.dimmings.push_back({{(*v)[0], (*v)[1]}, (*v)[2]});
  }
  if (!a->refocus.empty()) {
    const auto v = numbers(a->refocus, 2);
    if (!v) return malformed("--refocus", a->refocus, "TIME:FACTOR");
    a->options.refocus = simulator::Refocus{(*v)[0], (*v)[1]};
  }
  if (!a->moved.empty()) {
    const auto v = numbers(a->moved, 5);
    const auto id = v ? whole((*v)[0]) : std::nullopt;
    if (!id) return malformed("--move", a->moved, "ID:TIME:X,Y,Z");
    a->options.moved_marker =
        simulator::MovedMarker{*id, (*v)[1], Eigen::Vector3d((*v)[2], (*v)[3], (*v)[4])};
  }
  return success();
}

Status simulate(Arguments* a) {
  if (Status status = parseCompound(a); !status) return status;
  const auto simulation = simulator::Simulation::create(a->options, simulator::Ending::kOfTheScene);
  if (!simulation) return simulation.error();
  if (a->truth_only) return simulator::recordTruth(**simulation, a->out);
  a->recording.directory = a->out;
  a->recording.threads = static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  ProgressBar bar((*simulation)->frameCount(), /*wanted=*/!a->quiet);
  a->recording.progress = [&bar](std::int64_t frames_done) { bar.update(frames_done); };
  return simulator::record(**simulation, a->recording);
}

std::string sceneHelp() {
  std::string text = "One of:";
  for (const simulator::SceneInfo& scene : simulator::sceneList()) {
    text += "\n" + scene.name + ": " + scene.description;
  }
  return text;
}

void addOptions(CLI::App* command, Arguments* a) {
  simulator::Options& o = a->options;
  command->add_option("SCENE", o.scene, sceneHelp())->required();
  command->add_option("--out", a->out, "Directory for the recording and its truth")->required();
  command->add_option("--seed", o.seed, "Everything random follows from it")->capture_default_str();
  command->add_option("--size", a->size, "Image size, WIDTHxHEIGHT pixels; else the scene's");
  command->add_option("--fps", o.rate_hz, "Frames per second; else the scene's");
  command->add_option("--duration", o.duration_s, "Seconds; else the scene's");
  command->add_option("--dictionary", o.dictionary, "Marker dictionary")->capture_default_str();
  command->add_option("--marker-size", o.marker_size_m, "Metres; else the scene's");
  command->add_option("--noise", o.noise_sigma, "Noise sigma, grey levels")->capture_default_str();
  command->add_option("--blur", o.psf_sigma_px, "Blur sigma of the lens, pixels")
      ->capture_default_str();
  command->add_option("--vignetting", o.vignetting, "Light lost in the corners, 0 to 1")
      ->capture_default_str();
  command->add_option("--exposure", o.exposure_s, "Exposure (motion blur), seconds")
      ->capture_default_str();
  command->add_option("--fisheye", o.fisheye_deg,
                      "An equidistant lens of so many degrees across, instead of the scene's");
  command->add_option("--refocus", a->refocus,
                      "From TIME seconds on FACTOR times the focal length, TIME:FACTOR");
  command->add_option("--readout", o.readout_s, "Rolling shutter, first to last row, seconds")
      ->capture_default_str();
  command->add_option("--pictures", o.pictures,
                      "Directory of photographs (jpg, png) that hang in the scene; else posters");
  command->add_option("--blackout", a->blackouts, "No light from BEGIN to END seconds, BEGIN:END");
  command->add_option("--dim", a->dimmings, "Less light for a while, BEGIN:END:FACTOR");
  command->add_option("--move", a->moved,
                      "A marker that moves by X,Y,Z metres at TIME seconds, ID:TIME:X,Y,Z");
  command->add_option("--double", o.doubled_id, "An id that is printed twice");
  CLI::Option* const images =
      command->add_flag("--images", a->recording.images, "PNG images instead of a video (FFV1)");
  command->add_flag("--truth-only", a->truth_only, "The truth without the frames, in moments")
      ->excludes(images);
  command->add_flag("--quiet", a->quiet, "No progress bar");
}

}  // namespace

void addSimulateCommand(CLI::App& app, int* exit_code) {
  CLI::App* const command =
      app.add_subcommand("simulate", "Render a sequence with exact truth, as a recording");
  const auto arguments = std::make_shared<Arguments>();
  addOptions(command, arguments.get());
  command->callback([arguments, exit_code] {
    const Status status = simulate(arguments.get());
    if (!status) std::fprintf(stderr, "waymark: %s\n", status.error().message.c_str());
    *exit_code = status ? kDone : kBadInput;
  });
}

}  // namespace waymark::tools
