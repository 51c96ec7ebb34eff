// Lines on their way to a file that may stand still: a pipe that nobody reads, a terminal that was
// stopped, a journal that hangs. A thread of its own writes them; whoever has something to say
// never waits for it.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace waymark::daemon {

class LineWriter {
 public:
  struct Options {
    // That wait to be written; more are lost. Of ordinary lines some 100 kB, and minutes of the
    // busiest log.
    std::size_t max_lines = 1000;
    // At the end, for a reader that takes nothing.
    std::chrono::milliseconds patience{500};
  };
  // What is written once there is room again, given how many lines were lost.
  using LossLine = std::function<std::string(std::uint64_t lost)>;

  // Writes to a copy of `fd`.
  LineWriter(int fd, LossLine loss_line, const Options& options);
  LineWriter(int fd, LossLine loss_line) : LineWriter(fd, std::move(loss_line), Options{}) {}
  LineWriter(const LineWriter&) = delete;
  LineWriter& operator=(const LineWriter&) = delete;
  // As drain(). A thread that hangs in a write is left alone.
  ~LineWriter();

  // Any thread: a line with its newline. Takes a lock that nobody holds for longer than it takes to
  // put a line into the queue, or all of them out of it.
  void add(std::string line);
  // Any thread: waits until everything is written, or for as long as something is.
  void drain();
  // Any thread: lines that found no room, or could not be written.
  [[nodiscard]] std::uint64_t lost() const;

 private:
  struct State;

  static void run(State* state);
  static void writeAll(State* state, const std::vector<std::string>& lines);
  static void write(State* state, const std::string& line);

  const std::shared_ptr<State> state_;  // the thread's, too, which may outlive this object
  const Options options_;
  std::thread thread_;
};

}  // namespace waymark::daemon
