#include "capture/image_directory_source.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <fstream>
#include <iterator>
#include <limits>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "base/coded_image.h"
#include "base/decimal_seconds.h"
#include "base/image_view.h"

namespace waymark::capture {
namespace fs = std::filesystem;
namespace {

constexpr double kDefaultRate = 30.0;  // Hz
constexpr const char* kTimesFile = "frames.txt";

struct ImageFile {
  fs::path path;
  std::int64_t time_ns = 0;
};

bool isImage(const fs::path& path) {
  constexpr std::array<std::string_view, 7> kExtensions = {".jpg", ".jpeg", ".png", ".pgm",
                                                           ".bmp", ".tif",  ".tiff"};
  std::string extension = path.extension().string();
  for (char& c : extension) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(kExtensions.begin(), kExtensions.end(), extension) != kExtensions.end();
}

Result<std::vector<ImageFile>> listImages(const fs::path& directory) {
  std::vector<ImageFile> files;
  std::error_code error;
  for (fs::directory_iterator entry(directory, error), end; !error && entry != end;
       entry.increment(error)) {
    if (isImage(entry->path())) files.push_back({entry->path()});
  }
  if (error) return Error{directory.string() + ": cannot be read: " + error.message()};
  std::sort(files.begin(), files.end(), [](const ImageFile& a, const ImageFile& b) {
    return a.path.filename().native() < b.path.filename().native();
  });
  return files;
}

Result<std::vector<ImageFile>> readTimes(const fs::path& times_file) {
  std::ifstream stream(times_file);
  if (!stream) return Error{times_file.string() + ": cannot be read"};
  std::vector<ImageFile> files;
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    std::istringstream fields(line.substr(0, line.find('#')));
    std::string name, seconds, extra;
    if (!(fields >> name)) continue;
    const std::string place = times_file.string() + ":" + std::to_string(number) + ": ";
    if (!(fields >> seconds) || (fields >> extra)) {
      return Error{place + "must be: FILE SECONDS"};
    }
    const std::optional<std::int64_t> time_ns = parseSeconds(seconds);
    if (!time_ns) return Error{place + "'" + seconds + "' is not a time in seconds"};
    if (!files.empty() && *time_ns <= files.back().time_ns) {
      return Error{place + "time " + seconds + " is not later than the one before"};
    }
    files.push_back({times_file.parent_path() / name, *time_ns});
  }
  return files;
}

Result<cv::Mat> readGrey(const fs::path& path) {
  const Error unreadable{path.string() + ": is not a readable image"};
  std::error_code error;
  if (!fs::is_regular_file(path, error)) return unreadable;  // opening a FIFO waits for its writer
  std::ifstream stream(path, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  if (!stream || bytes.empty() || bytes.size() > std::numeric_limits<int>::max()) return unreadable;
  if (const char* fault = imageFault(bytes)) return Error{path.string() + ": " + fault};
  const cv::Mat coded(1, static_cast<int>(bytes.size()), CV_8U, bytes.data());
  try {
    cv::Mat grey = cv::imdecode(coded, cv::IMREAD_GRAYSCALE | cv::IMREAD_IGNORE_ORIENTATION);
    if (!grey.empty()) return grey;
  } catch (const cv::Exception&) {
    // As of an image that has none.
  }
  return unreadable;
}

class ImageDirectorySource final : public FrameSource {
 public:
  ImageDirectorySource(std::vector<ImageFile> files, StreamInfo info, int buffers)
      : files_(std::move(files)),
        info_(std::move(info)),
        pool_(info_.width, info_.height, buffers) {}

  [[nodiscard]] const StreamInfo& info() const override { return info_; }
  [[nodiscard]] SourceCounters counters() const override { return {.frames = next_}; }
  [[nodiscard]] std::string frameName(std::uint64_t sequence) const override {
    return files_[sequence].path.filename().string();
  }

  [[nodiscard]] ReadResult read(std::chrono::milliseconds /*timeout*/) override {
    if (next_ == files_.size()) return EndOfStream{};
    FramePtr frame = pool_.acquire();
    if (!frame) return TimedOut{};  // nothing is lost: the next call goes on here
    const ImageFile& file = files_[next_];
    const Result<cv::Mat> decoded = readGrey(file.path);
    if (!decoded) return decoded.error();
    const cv::Mat& image = *decoded;
    if (image.cols != info_.width || image.rows != info_.height) {
      return Error{file.path.string() + ": is " + sizeText(image.cols, image.rows) +
                   ", the images before are " + sizeText(info_.width, info_.height)};
    }
    image.copyTo(cv::Mat(info_.height, info_.width, CV_8UC1, frame->pixels()));
    frame->setStamp(
        {.sequence = next_, .monotonic_ns = file.time_ns, .utime = file.time_ns / 1000});
    ++next_;
    return frame;
  }

 private:
  std::vector<ImageFile> files_;
  StreamInfo info_;
  std::size_t next_ = 0;
  FramePool pool_;
};

double meanRate(const std::vector<ImageFile>& files) {
  if (files.size() < 2) return 0.0;
  const auto span_ns = static_cast<double>(files.back().time_ns - files.front().time_ns);
  return 1e9 * static_cast<double>(files.size() - 1) / span_ns;
}

}  // namespace

Result<std::unique_ptr<FrameSource>> openImageDirectory(const fs::path& path,
                                                        std::optional<double> fps, int buffers) {
  std::error_code error;
  const bool timed = fs::exists(path / kTimesFile, error);
  Result<std::vector<ImageFile>> listed = timed ? readTimes(path / kTimesFile) : listImages(path);
  if (!listed) return listed.error();
  std::vector<ImageFile> files = std::move(listed).value();
  if (files.empty()) return Error{path.string() + ": has no images"};

  const bool recorded_times = timed && !fps;
  StreamInfo info;
  info.rate_hz = recorded_times ? meanRate(files) : fps.value_or(kDefaultRate);
  if (!recorded_times) {
    for (std::size_t i = 0; i < files.size(); ++i) {
      files[i].time_ns = std::llround(1e9 * static_cast<double>(i) / info.rate_hz);
    }
  }
  const Result<cv::Mat> first = readGrey(files.front().path);
  if (!first) return first.error();
  info.width = first->cols;
  info.height = first->rows;
  info.frame_count = static_cast<std::int64_t>(files.size());
  info.photographs = !recorded_times && !fps;
  char text[80];
  std::snprintf(text, sizeof text, ", %zu images, %dx%d, %.4g Hz%s", files.size(), info.width,
                info.height, info.rate_hz, info.photographs ? " (assumed)" : "");
  info.description = path.string() + text;
  return std::unique_ptr<FrameSource>(
      std::make_unique<ImageDirectorySource>(std::move(files), std::move(info), buffers));
}

}  // namespace waymark::capture
