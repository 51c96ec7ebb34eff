#include "capture/eventlog/rolling_log.h"

#include <algorithm>
#include <cerrno>
#include <utility>

#include <sys/statvfs.h>
#include <unistd.h>

#include "base/system_reason.h"
#include "capture/eventlog/log_reader.h"

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
  log.repaired_ = log.repairNewest();
  return log;
}

// What became of it. A log that cannot be cut is no reason not to write others.
std::string RollingLog::repairNewest() const {
  const std::vector<OldFile> old = files();
  if (old.empty()) return "";
  const fs::path& newest = old.back().path;
  const Result<std::uint64_t> end = endOfLastEvent(newest);
  if (!end) return end.error().message;
  const std::uint64_t torn = old.back().bytes - std::min(*end, old.back().bytes);
  if (torn == 0) return "";
  std::error_code error;
  fs::resize_file(newest, *end, error);
  if (error) return newest.string() + ": cannot be cut: " + error.message();
  return newest.string() + ": cut off the last " + std::to_string(torn) +
         " bytes, which were no whole event";
}

// In the order in which they were made. What has no name that we give, or is a link, is not ours.
std::vector<RollingLog::OldFile> RollingLog::files() const {
  std::vector<OldFile> all;
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(options_.directory, error)) {
    std::optional<FileAge> age = fileAge(options_.prefix, entry.path().filename().native());
    if (!age || entry.symlink_status(error).type() != fs::file_type::regular) continue;
    const std::uintmax_t bytes = entry.file_size(error);
    all.push_back({entry.path(), *std::move(age), error ? 0 : bytes});
  }
  std::ranges::sort(all, {}, &OldFile::age);
  return all;
}

void RollingLog::append(std::int64_t utime, std::string_view channel,
                        std::span<const std::uint8_t> data, std::int64_t monotonic_ns) {
  now_ns_ = monotonic_ns;
  if (unchecked_ > kCheckBytes) checkDisk();
  if (state() == State::kRecording && writer_ && fileIsFull(data.size())) {
    finish();
  }
  const bool may_begin = state() == State::kRecording || pause_.over;
  const bool first = !writer_;
  if (first && (!may_begin || !begin(utime))) {
    ++counters_.lost;
    return;
  }
  const std::uint64_t before = writer_->bytes();
  Status added = writer_->append(utime, channel, data);
  // What lets us make a file and put nothing into it is found here, before anybody is told that it
  // records.
  if (!added) {
    ++counters_.lost;
  } else if (first) {
    added = writer_->flush();
  }
  if (!added) {
    pauseByError();
    return;
  }
  if (first) noteBegun();
  ++counters_.events;
  counters_.bytes += writer_->bytes() - before;
  unchecked_ += writer_->bytes() - before;
}

bool RollingLog::fileIsFull(std::size_t more) const {
  return writer_->bytes() + more > options_.file_bytes ||
         now_ns_ - begun_ns_ > options_.file_s * 1000 * kMs_ns;
}

// The next file. False when it pauses, or goes on to.
bool RollingLog::begin(std::int64_t utime) {
  pause_.over = false;
  if (!hasRoom()) return false;
  makeRoom();
  if (const Status begun = createFile(utime); !begun) {
    pauseByError();
    return false;
  }
  begun_ns_ = now_ns_;
  flush_ns_ = now_ns_ + options_.flush_ms * kMs_ns;
  return true;
}

// Its first event is on the disk.
void RollingLog::noteBegun() {
  if (state() == State::kPaused) recording_since_ns_ = now_ns_;
  pause_ = {};
  ++counters_.files;
}

// After an error errno tells of it.
Status RollingLog::createFile(std::int64_t utime) {
  if (recording_.empty() || number_ == kMaxFiles) {
    const std::vector<OldFile> old = files();
    const auto newest = old.empty() ? std::nullopt : std::optional(old.back().age);
    recording_ = nextRecording(options_.prefix, utime, newest);
    number_ = 0;
  }
  Error error{recording_ + ": has too many files"};
  // A number that is taken is one of another recording that began at this moment.
  for (; number_ < kMaxFiles; ++number_) {
    Result<LogWriter> created =
        LogWriter::create(options_.directory / fileName(recording_, number_));
    if (created) {
      writer_.emplace(std::move(created).value());
      return beginFile(utime);
    }
    error = created.error();
    if (errno != EEXIST) break;
  }
  return error;
}

Status RollingLog::beginFile(std::int64_t utime) {
  ++number_;
  preamble_bytes_ = ~std::uint64_t{0};  // until it is whole
  for (const RollingOptions::Preamble& event : options_.preamble) {
    if (Status added = writer_->append(utime, event.channel, event.data); !added) return added;
  }
  preamble_bytes_ = writer_->bytes();
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

// After a pause for want of room.
std::uint64_t RollingLog::bytesToGoOn() const {
  return std::max(options_.keep_free_bytes + options_.keep_free_bytes / 2, options_.room_bytes);
}

void RollingLog::checkDisk() {
  check_ns_ = now_ns_ + kCheck_ns;
  unchecked_ = 0;
  if (state() == State::kPaused && !pause_.for_want_of_room) {
    pause_.over = now_ns_ >= pause_.retry_ns;
  } else if (hasRoom() && state() == State::kPaused) {
    pause_.over = freeBytes().value_or(0) >= bytesToGoOn();
  }
}

// False when it pauses for want of it.
bool RollingLog::hasRoom() {
  const std::optional<std::uint64_t> free = freeBytes();
  if (free && *free >= options_.keep_free_bytes) return true;
  free ? pauseForRoom(*free) : pauseByError();
  return false;
}

// The number of free bytes as it was first: else there would be news with every file that others
// write.
void RollingLog::pauseForRoom(std::uint64_t free) {
  pause_.over = false;
  if (pause_.for_want_of_room) return;
  pause(options_.directory.string() + ": the disk is full: " + std::to_string(free >> 20U) +
        " MiB are free, and " + std::to_string(options_.keep_free_bytes >> 20U) +
        " are left to others");
  pause_.for_want_of_room = true;
}

// By errno. No room is what more room ends, whatever the system calls it: a quota may look like it,
// and missing inodes do not.
void RollingLog::pauseByError() {
  const std::string reason = options_.directory.string() + ": cannot be written: " + systemReason();
  const std::optional<std::uint64_t> free = freeBytes();
  // Once it has gone well for long enough the next trouble is another one.
  const std::int64_t went_well_ns = now_ns_ - recording_since_ns_;
  if (state() == State::kRecording && went_well_ns > options_.retry_max_s * 1000 * kMs_ns) {
    retry_s_ = 0;
  }
  pause(reason);
  pause_.over = false;
  pause_.for_want_of_room = free && *free < bytesToGoOn();
  if (pause_.for_want_of_room) return;
  retry_s_ = std::clamp(2 * retry_s_, options_.retry_first_s, options_.retry_max_s);
  pause_.retry_ns = now_ns_ + retry_s_ * 1000 * kMs_ns;
}

void RollingLog::pause(std::string reason) {
  if (state() == State::kRecording) ++counters_.pauses;
  pause_.reason = std::move(reason);
  leaveFile();
}

// What there is of the file is worth keeping, unless it is nothing; that it cannot be written any
// more is known.
void RollingLog::leaveFile() {
  if (!writer_) return;
  (void)writer_->flush();
  const auto preamble = static_cast<std::int64_t>(options_.preamble.size());
  const std::int64_t unwritten = writer_->events() - std::max(writer_->wholeEvents(), preamble);
  counters_.lost += static_cast<std::uint64_t>(std::max<std::int64_t>(unwritten, 0));
  if (writer_->wholeBytes() <= preamble_bytes_ && ::unlink(writer_->file().c_str()) == 0) {
    --number_;  // those of a recording follow one another
  }
  writer_.reset();
}

void RollingLog::maintain(std::int64_t monotonic_ns) {
  now_ns_ = monotonic_ns;
  if (now_ns_ >= check_ns_) checkDisk();
  if (!writer_ || now_ns_ < flush_ns_) return;
  flush_ns_ = now_ns_ + options_.flush_ms * kMs_ns;
  if (const Status flushed = writer_->flush(); !flushed) pauseByError();
}

void RollingLog::finish() {
  if (!writer_) return;
  if (const Status flushed = writer_->flush(); !flushed) {
    pauseByError();
    return;
  }
  writer_.reset();
}

}  // namespace waymark::eventlog
