// Rendered frames that are kept in a file, for who measures the same scene again and again:
// rendering takes longer than what is measured.
#pragma once

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "simulator/simulation.h"

namespace waymark::bench {

class KeptFrames {
 public:
  // folder: empty, and nothing is kept.
  KeptFrames(const simulator::Simulation& simulation, const std::filesystem::path& folder)
      : simulation_(simulation),
        bytes_(static_cast<std::size_t>(simulation.camera().width) *
               static_cast<std::size_t>(simulation.camera().height)) {
    if (folder.empty()) return;
    const simulator::Options& options = simulation.options();
    const std::string name = options.scene + "-" + std::to_string(options.seed) + "-" +
                             std::to_string(simulation.camera().width) + "-" +
                             std::to_string(simulation.scene().rate_hz) + "-" +
                             std::to_string(simulation.frameCount()) +
                             (options.pictures.empty() ? "" : "-photographs");
    std::filesystem::create_directories(folder);
    path_ = folder / name;
    const bool whole = std::filesystem::exists(path_);
    reading_ = whole;
    // What is not whole has another name.
    file_.reset(std::fopen((whole ? path_.string() : partial()).c_str(), whole ? "rb" : "wb"));
  }
  ~KeptFrames() {
    const bool done = file_ && !reading_ && written_ == simulation_.frameCount();
    file_.reset();
    if (done) std::filesystem::rename(partial(), path_);
  }
  KeptFrames(const KeptFrames&) = delete;
  KeptFrames& operator=(const KeptFrames&) = delete;

  // Frames in their order. pixels: of the camera's size.
  void next(std::int64_t frame, std::vector<std::uint8_t>* pixels) {
    pixels->resize(bytes_);
    if (reading_ && std::fread(pixels->data(), 1, bytes_, file_.get()) == bytes_) return;
    simulation_.render(frame, &workspace_, pixels->data());
    if (!reading_ && file_ && std::fwrite(pixels->data(), 1, bytes_, file_.get()) == bytes_) {
      ++written_;
    }
  }

 private:
  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  [[nodiscard]] std::string partial() const { return path_.string() + ".partial"; }

  const simulator::Simulation& simulation_;
  std::size_t bytes_;
  std::filesystem::path path_;
  std::unique_ptr<std::FILE, Close> file_;
  bool reading_ = false;
  std::int64_t written_ = 0;
  simulator::Simulation::Workspace workspace_;
};

}  // namespace waymark::bench
