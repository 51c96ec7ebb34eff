#include "tools/source_look.h"

#include <chrono>
#include <cstdio>
#include <utility>
#include <variant>

#include "daemon/configuration.h"
#include "daemon/publish/lcm_link.h"

namespace waymark::tools {

using diagnosis::Finding;
using Level = diagnosis::Finding::Level;

void tell(const diagnosis::Finding& finding) {
  std::fputs(diagnosis::formatFinding(finding).c_str(), stdout);
}

std::string withPermissionHint(const std::string& fault) {
  if (fault.find("Permission denied") == std::string::npos) return fault;
  return fault +
         "; cameras belong to the group video: sudo usermod -aG video $USER, then log in "
         "again";
}

Result<Looked> lookAt(capture::FrameSource& source, int frames, const daemon::StopSignal& stop) {
  using std::chrono_literals::operator""ms;
  Looked looked;
  looked.info = source.info();
  int silent_ms = 0;
  while (std::ssize(looked.times_ns) < frames && !stop.pending()) {
    capture::ReadResult read = source.read(100ms);
    if (const Error* error = std::get_if<Error>(&read)) {
      looked.damage = error->message;
      break;
    }
    if (std::holds_alternative<capture::EndOfStream>(read)) break;
    if (std::holds_alternative<capture::TimedOut>(read)) {
      silent_ms += 100;
      if (silent_ms < 5000) continue;
      looked.damage = looked.info.description + ": no frame for 5 s";
      break;
    }
    silent_ms = 0;
    const capture::FramePtr frame = std::get<capture::FramePtr>(std::move(read));
    looked.times_ns.push_back(frame->stamp().monotonic_ns);
    looked.samples.add(frame->image());
  }
  if (looked.damage.empty()) looked.damage = source.damage();
  if (looked.times_ns.empty()) {
    return Error{looked.damage.empty() ? looked.info.description + ": has no frames"
                                       : looked.damage};
  }
  return looked;
}

void tellOfSource(const Looked& looked) {
  tell({Level::kGood, "source", looked.info.description});
  for (const std::string& warning : looked.info.warnings) tell({Level::kNote, "source", warning});
  if (!looked.damage.empty()) tell({Level::kBad, "source", looked.damage});
  if (looked.info.photographs) {
    tell({Level::kNote, "times",
          "nobody says when the images were taken: one is not followed to "
          "the next (frames.txt or --fps of waymark run say it)"});
  } else {
    tell(diagnosis::timesFinding(looked.times_ns, looked.info.rate_hz));
  }
  const auto quality = diagnosis::medianQuality(looked.samples.images());
  for (const Finding& finding : diagnosis::qualityFindings(quality)) tell(finding);
}

void tellOfComputer() {
  const std::string url = daemon::Configuration::Publish{}.url;
  const auto address = daemon::multicastAddress(url);
  const bool route = address && daemon::hasRoute(*address);
  tell(route ? Finding{Level::kGood, "multicast", "there is a route for " + url}
             : Finding{Level::kBad, "multicast",
                       "no route for " + url +
                           ": sudo ip link set lo multicast on; sudo ip route "
                           "add 224.0.0.0/4 dev lo"});
}

}  // namespace waymark::tools
