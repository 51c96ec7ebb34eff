// A recording without end in a directory of limited size: one log after the other, the oldest
// deleted when there are too many, paused while the disk is full or fails.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"
#include "capture/eventlog/log_writer.h"
#include "capture/eventlog/recording_name.h"

namespace waymark::eventlog {

struct RollingOptions {
  std::filesystem::path directory;
  std::string prefix = "waymark";  // of file names; files with another are nobody's business

  std::uint64_t file_bytes = std::uint64_t{2} << 30U;  // then the next file begins
  std::int64_t file_s = 600;                           // likewise
  // Of all files of ours together; the oldest give way. 0: no limit.
  std::uint64_t quota_bytes = 0;
  // Of the disk, left to others: below, recording pauses, and goes on with half as much again.
  std::uint64_t keep_free_bytes = std::uint64_t{500} << 20U;
  // What a power cut may cost: what was added since is not on the disk yet.
  std::int64_t flush_ms = 1000;
  // After a pause for want of room, where keep_free_bytes asks for less: enough for a file that is
  // worth beginning.
  std::uint64_t room_bytes = std::uint64_t{4} << 20U;

  // What else than room is missing (a quota, inodes, rights, a disk that works) comes back with
  // nobody telling: tried again after so long, then after twice as long, ...
  std::int64_t retry_first_s = 5;
  std::int64_t retry_max_s = 60;  // so seldom that a log of it stays readable

  // What every file begins with, so that it can be understood without the others.
  struct Preamble {
    std::string channel;
    std::vector<std::uint8_t> data;
  };
  std::vector<Preamble> preamble;
};

// For one thread. Times are given, so that tests need not wait.
class RollingLog {
 public:
  enum class State { kRecording, kPaused };

  // Makes the directory if it is not there, and cuts the newest log, whose writer may have been
  // killed, to its last whole event. What cannot be cut is told, and stays.
  [[nodiscard]] static Result<RollingLog> open(const RollingOptions& options);

  // Adds an event to the current file, or loses it while recording pauses; both are counted. Names
  // of files have `utime`, and the order in which they are made even if that goes back.
  void append(std::int64_t utime, std::string_view channel, std::span<const std::uint8_t> data,
              std::int64_t monotonic_ns);
  // To be called now and then, also when nothing is added: flushes, and looks whether a pause is
  // over.
  void maintain(std::int64_t monotonic_ns);
  // Everything is on the disk; the next append() begins a new file.
  void finish();

  [[nodiscard]] State state() const {
    return pause_.reason.empty() ? State::kRecording : State::kPaused;
  }
  // Why it pauses, in words that do not change until the reason does; empty while it records.
  [[nodiscard]] const std::string& reason() const { return pause_.reason; }
  // The file that is being written; empty when there is none.
  [[nodiscard]] std::filesystem::path file() const {
    return writer_ ? writer_->file() : std::filesystem::path();
  }
  // Of the log that open() found torn: its name and how much was cut off, or why it was not. Empty
  // when none was.
  [[nodiscard]] const std::string& repaired() const { return repaired_; }

  struct Counters {
    std::uint64_t events = 0;  // added to a file
    std::uint64_t bytes = 0;
    std::uint64_t lost = 0;   // not recorded while it paused; or added, and then not to be written
    std::uint64_t files = 0;  // begun, with something on the disk
    std::uint64_t deleted = 0;  // files that gave way
    std::uint64_t pauses = 0;

    bool operator==(const Counters&) const = default;
  };
  [[nodiscard]] const Counters& counters() const { return counters_; }

 private:
  struct OldFile {
    std::filesystem::path path;
    FileAge age;
    std::uint64_t bytes = 0;
  };
  struct Pause {
    std::string reason;         // empty: it records
    bool over = false;          // the next event may try
    std::int64_t retry_ns = 0;  // monotonic, if it is not for want of room
    bool for_want_of_room = false;
  };

  explicit RollingLog(RollingOptions options) : options_(std::move(options)) {}
  [[nodiscard]] std::string repairNewest() const;
  [[nodiscard]] std::vector<OldFile> files() const;
  [[nodiscard]] bool begin(std::int64_t utime);
  void noteBegun();
  [[nodiscard]] Status createFile(std::int64_t utime);
  [[nodiscard]] Status beginFile(std::int64_t utime);
  [[nodiscard]] bool fileIsFull(std::size_t more) const;
  void makeRoom();
  [[nodiscard]] std::optional<std::uint64_t> freeBytes() const;
  [[nodiscard]] std::uint64_t bytesToGoOn() const;
  void checkDisk();
  [[nodiscard]] bool hasRoom();
  void pauseForRoom(std::uint64_t free);
  void pauseByError();
  void pause(std::string reason);
  void leaveFile();

  RollingOptions options_;
  std::optional<LogWriter> writer_;
  Pause pause_;
  std::string repaired_;
  std::string recording_;                // the name of its files, without their numbers
  int number_ = 0;                       // of the next file
  std::uint64_t preamble_bytes_ = 0;     // of the current file
  std::int64_t now_ns_ = 0;              // as last told, monotonic
  std::int64_t begun_ns_ = 0;            // the current file, monotonic
  std::int64_t recording_since_ns_ = 0;  // the last pause, monotonic
  std::int64_t retry_s_ = 0;             // the last wait; 0: none
  std::int64_t flush_ns_ = 0;            // next, monotonic
  std::int64_t check_ns_ = 0;            // next look at the disk, monotonic
  std::uint64_t unchecked_ = 0;          // bytes written since the last look
  Counters counters_;
};

}  // namespace waymark::eventlog
