// System calls made from inside another process, as if its own program made them: so one sees what
// it may do, and not what a likeness of it may. Tests in the guest only; x86-64.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include <sys/types.h>
#include <sys/user.h>

namespace waymark::testing {

// Holds one thread of a process, which must be waiting in a system call; it goes on with that when
// this object is gone.
class InsideCall {
 public:
  // Check held() before anything else.
  explicit InsideCall(pid_t thread);
  InsideCall(const InsideCall&) = delete;
  InsideCall& operator=(const InsideCall&) = delete;
  ~InsideCall();

  [[nodiscard]] bool held() const { return held_; }

  // What the system answered: negative is -errno. Empty when the call could not be made.
  std::optional<long> call(long number, std::array<std::uint64_t, 6> arguments = {});
  // Puts bytes where the process can read them, and returns their address. The next call of place()
  // overwrites them.
  std::uint64_t place(const std::string& bytes);

  // The usual ones.
  std::optional<long> open(const std::string& path, int flags);
  std::optional<long> socket(int family, int type);
  void close(long fd);

 private:
  const pid_t thread_;
  bool held_ = false;
  user_regs_struct registers_{};  // as they were
};

// A thread that stands still, for as long as this object lives or the process does. For one thread
// of the test only.
class StoppedThread {
 public:
  explicit StoppedThread(pid_t thread);
  StoppedThread(const StoppedThread&) = delete;
  StoppedThread& operator=(const StoppedThread&) = delete;
  ~StoppedThread();

  [[nodiscard]] bool held() const { return held_; }
  // Takes note of the thread's end, if it has come. The end of the process is told to nobody
  // before.
  void takeNote();

 private:
  const pid_t thread_;
  bool held_ = false;
};

// The thread of that name; -1 without one.
[[nodiscard]] pid_t threadNamed(pid_t process, const std::string& name);

}  // namespace waymark::testing
