// What of the health messages belongs in the journal: changes, at a rate that people can read.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include <waymark/health_t.hpp>

namespace waymark::daemon {

class HealthJournal {
 public:
  struct Options {
    // A state that flickers is told at most this often, and then as it is.
    std::int64_t state_pause_ns = 1'000'000'000;
    // Counters of faults that keep growing likewise.
    std::int64_t faults_pause_ns = 10'000'000'000;
  };

  struct Changes {
    std::string state;   // empty: nothing new
    std::string lens;    // another one is in use; empty: none is
    std::string faults;  // the counters that have grown, and by how much; empty: none has
  };

  explicit HealthJournal(const Options& options) : options_(options) {}
  HealthJournal() : HealthJournal(Options{}) {}

  // To be called with each health message, whose monotonic_ns is the time.
  [[nodiscard]] Changes changes(const health_t& health);

  // One line: "tracking", "relocalizing: no marker of the map is in view; camera lost: ...".
  [[nodiscard]] static std::string describeState(const health_t& health);

 private:
  [[nodiscard]] std::string changedLens(const lens_t& lens);
  [[nodiscard]] std::string grownFaults(const health_t& health);

  const Options options_;
  std::string reported_state_;
  std::int64_t next_state_ns_ = 0;
  std::int32_t reported_lens_changes_ = 0;
  double reported_focal_px_ = 0.0;
  std::int64_t next_lens_ns_ = 0;
  std::int64_t next_faults_ns_ = 0;
  std::map<std::string, std::int64_t, std::less<>> reported_faults_;
};

}  // namespace waymark::daemon
