#include "capture/eventlog/rolling_log.h"

#include <algorithm>
#include <utility>

#include <sys/statvfs.h>

#include "base/system_reason.h"
#include "capture/eventlog/log_reader.h"
#include "capture/eventlog/recording_name.h"

namespace waymark::eventlog {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMs_ns = 1'000'000;
constexpr std::int64_t kCheck_ns = 500 * kMs_ns;
// Also after so much: a fast recording fills a disk between two looks.
constexpr std::uint64_t kCheckBytes = std::uint64_t{32} << 20U;

}  // namespace

Result<RollingLog> RollingLog::open(const RollingOptions& options) {
  std::error_code error;
  fs::create_directories(options.directory, error);
  if (error) {
    return Error{options.directory.string() + ": cannot be made: " + error.message()};
  }
  RollingLog log(options);
  if (const Status repaired = log.repairNewest(); !repaired) return repaired.error();
  return log;
}

Status RollingLog::repairNewest() {
  const std::vector<OldFile> old = files();
  if (old.empty()) return success();
  const fs::path& newest = old.back().path;
  Result<LogReader> reader = LogReader::open(newest);
  if (!reader) return reader.error();
  for (;;) {
    const Result<std::optional<Event>> event = reader->next();
    if (!event) return event.error();
    if (!*event) break;
  }
  const std::uint64_t torn = reader->size() - reader->endOfLast();
  if (torn == 0) return success();
  std::error_code error;
  fs::resize_file(newest, reader->endOfLast(), error);
  if (error) return Error{newest.string() + ": cannot be cut: " + error.message()};
  repaired_ = newest.string() + ": cut off the last " + std::to_string(torn) +
              " bytes, which were no whole event";
  return success();
}

// Names begin with the time, so that their order is that of time.
std::vector<RollingLog::OldFile> RollingLog::files() const {
  std::vector<OldFile> all;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(options_.directory, error)) {
    const std::string name = entry.path().filename();
    const bool ours = name.starts_with(options_.prefix + "-") && name.ends_with(kExtension) &&
                      entry.is_regular_file(error);
    if (!ours) continue;
    const std::uintmax_t bytes = entry.file_size(error);
    all.push_back({entry.path(), error ? 0 : bytes});
  }
  std::ranges::sort(all, {}, [](const OldFile& file) { return file.path.native(); });
  return all;
}

void RollingLog::append(std::int64_t utime, std::string_view channel,
                        std::span<const std::uint8_t> data, std::int64_t monotonic_ns) {
  if (unchecked_ > kCheckBytes) checkDisk(monotonic_ns);
  if (state() == State::kRecording && writer_ && fileIsFull(monotonic_ns, data.size())) finish();
  if (state() == State::kRecording && !writer_) {
    if (const Status begun = begin(utime, monotonic_ns); !begun) pause(begun.error().message);
  }
  if (state() == State::kPaused) {
    ++counters_.lost;
    return;
  }
  const std::uint64_t before = writer_->bytes();
  if (const Status added = writer_->append(utime, channel, data); !added) {
    ++counters_.lost;
    pause(added.error().message);
    return;
  }
  ++counters_.events;
  counters_.bytes += writer_->bytes() - before;
  unchecked_ += writer_->bytes() - before;
}

bool RollingLog::fileIsFull(std::int64_t monotonic_ns, std::size_t more) const {
  return writer_->bytes() + more > options_.file_bytes ||
         monotonic_ns - begun_ns_ > options_.file_s * 1000 * kMs_ns;
}

Status RollingLog::begin(std::int64_t utime, std::int64_t monotonic_ns) {
  checkDisk(monotonic_ns);
  if (state() == State::kPaused) return Error{reason_};
  makeRoom();
  if (recording_.empty() || number_ == kMaxFiles) {
    recording_ = recordingName(options_.prefix, utime);
    number_ = 0;
  }
  Error error;
  // A number that is taken is one of another recording that began at this moment.
  for (; number_ < kMaxFiles; ++number_) {
    const fs::path file = options_.directory / fileName(recording_, number_);
    Result<LogWriter> created = LogWriter::create(file);
    if (created) {
      writer_.emplace(std::move(created).value());
      begun_ns_ = monotonic_ns;
      flush_ns_ = monotonic_ns + options_.flush_ms * kMs_ns;
      ++counters_.files;
      ++number_;
      return writePreamble(utime);
    }
    error = created.error();
    std::error_code exists;
    if (!fs::exists(file, exists)) break;
  }
  return error;
}

Status RollingLog::writePreamble(std::int64_t utime) {
  for (const RollingOptions::Preamble& event : options_.preamble) {
    if (Status added = writer_->append(utime, event.channel, event.data); !added) return added;
  }
  return success();
}

// For a new file of full size.
void RollingLog::makeRoom() {
  if (options_.quota_bytes == 0) return;
  std::vector<OldFile> old = files();
  std::uint64_t total = options_.file_bytes;
  for (const OldFile& file : old) total += file.bytes;
  for (const OldFile& file : old) {
    if (total <= options_.quota_bytes) return;
    std::error_code error;
    if (!fs::remove(file.path, error)) continue;
    total -= file.bytes;
    ++counters_.deleted;
  }
}

std::optional<std::uint64_t> RollingLog::freeBytes() const {
  struct statvfs status {};
  if (statvfs(options_.directory.c_str(), &status) != 0) return {};
  return static_cast<std::uint64_t>(status.f_bavail) * status.f_frsize;
}

void RollingLog::checkDisk(std::int64_t monotonic_ns) {
  check_ns_ = monotonic_ns + kCheck_ns;
  unchecked_ = 0;
  const std::optional<std::uint64_t> free = freeBytes();
  if (!free) {
    pause(options_.directory.string() + ": " + systemReason());
    return;
  }
  const std::uint64_t keep = options_.keep_free_bytes;
  if (*free < keep) {
    pause(options_.directory.string() + ": the disk is full: " + std::to_string(*free >> 20U) +
          " MiB are free, and " + std::to_string(keep >> 20U) + " are left to others");
  } else if (state() == State::kPaused && *free >= keep + keep / 2) {
    reason_.clear();
  }
}

void RollingLog::pause(std::string reason) {
  if (state() == State::kRecording) ++counters_.pauses;
  reason_ = std::move(reason);
  if (!writer_) return;
  // What there is of the file is worth keeping; that it cannot be written any more is known.
  (void)writer_->flush();
  writer_.reset();
}

void RollingLog::maintain(std::int64_t monotonic_ns) {
  if (monotonic_ns >= check_ns_) checkDisk(monotonic_ns);
  if (!writer_ || monotonic_ns < flush_ns_) return;
  flush_ns_ = monotonic_ns + options_.flush_ms * kMs_ns;
  if (const Status flushed = writer_->flush(); !flushed) pause(flushed.error().message);
}

void RollingLog::finish() {
  if (!writer_) return;
  if (const Status flushed = writer_->flush(); !flushed) {
    pause(flushed.error().message);
    return;
  }
  writer_.reset();
}

}  // namespace waymark::eventlog
