#include "capture/mode_choice.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <sstream>
#include <tuple>

#include "base/image_view.h"
#include "capture/pixel_format.h"

namespace waymark::capture {
namespace {

// Rates come as ratios of integers: 30000/1001 is what somebody means who asks for 30.
constexpr double kSameRate = 0.995;
// Without a size asked for, a larger picture is not worth less than this.
constexpr double kUsualRate_hz = 30.0;

std::string rateText(double rate_hz) {
  std::ostringstream text;
  text.precision(4);
  text << rate_hz;
  return text.str();
}

bool within(int value, int min, int max, int step) {
  return value >= min && value <= max && (value - min) % std::max(step, 1) == 0;
}

bool offersSize(const OfferedMode& mode, int width, int height) {
  return within(width, mode.min_width, mode.max_width, mode.width_step) &&
         within(height, mode.min_height, mode.max_height, mode.height_step);
}

// Slowest of those fast enough, or the fastest. asked_hz 0: the fastest.
double bestRate(const std::vector<double>& rates_hz, double asked_hz) {
  if (rates_hz.empty()) return 0.0;
  double best = rates_hz.front();
  for (const double rate : rates_hz) {
    if (asked_hz > 0.0 && rate >= kSameRate * asked_hz) best = std::min(best, rate);
  }
  return best;
}

struct Candidate {
  ChosenMode mode;
  bool fast_enough = false;
  int cost = 0;
};

Candidate candidate(const OfferedMode& offered, const CameraOptions& asked) {
  Candidate c;
  c.mode.fourcc = offered.fourcc;
  c.mode.width = asked.width > 0 ? asked.width : offered.max_width;
  c.mode.height = asked.height > 0 ? asked.height : offered.max_height;
  c.mode.rate_hz = bestRate(offered.rates_hz, asked.rate_hz);
  const double wanted =
      asked.rate_hz > 0.0 ? asked.rate_hz : (asked.width > 0 ? 0.0 : kUsualRate_hz);
  c.fast_enough = offered.rates_hz.empty() || c.mode.rate_hz >= kSameRate * wanted;
  c.cost = findPixelFormat(offered.fourcc)->cost;
  return c;
}

// Fast enough first; then, where that was not asked for, larger; then, when not fast enough or when
// no rate was asked for, faster; then cheaper.
bool better(const Candidate& a, const Candidate& b, bool rate_asked) {
  const auto key = [&](const Candidate& c) {
    const double speed = c.fast_enough && rate_asked ? 0.0 : c.mode.rate_hz;
    return std::tuple(c.fast_enough, std::int64_t{c.mode.width} * c.mode.height, speed, -c.cost);
  };
  return key(a) > key(b);
}

std::string listFormats(std::span<const OfferedMode> offered) {
  std::set<std::string> names;
  for (const OfferedMode& mode : offered) names.insert(fourccText(mode.fourcc));
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text.empty() ? "nothing" : text;
}

Error noSize(std::span<const OfferedMode> offered, const CameraOptions& asked) {
  std::string text;
  for (const OfferedMode& mode : offered) {
    if (findPixelFormat(mode.fourcc) == nullptr) continue;
    text += (text.empty() ? "" : "; ") + fourccText(mode.fourcc) + " " + describeSize(mode);
  }
  return {"does not offer " + sizeText(asked.width, asked.height) + "; it offers " + text};
}

}  // namespace

std::string describeSize(const OfferedMode& mode) {
  std::string text = sizeText(mode.min_width, mode.min_height);
  if (mode.min_width != mode.max_width || mode.min_height != mode.max_height) {
    text += " to " + sizeText(mode.max_width, mode.max_height) + " in steps of " +
            sizeText(mode.width_step, mode.height_step) + " pixels";
  }
  std::string rates;
  for (const double rate : mode.rates_hz) rates += (rates.empty() ? "" : ", ") + rateText(rate);
  return rates.empty() ? text : text + " at " + rates + " Hz";
}

Result<ChosenMode> chooseMode(std::span<const OfferedMode> offered, const CameraOptions& asked) {
  std::vector<OfferedMode> usable;
  std::ranges::copy_if(offered, std::back_inserter(usable), [&](const OfferedMode& mode) {
    return findPixelFormat(mode.fourcc) != nullptr &&
           (asked.format.empty() || readFourcc(asked.format) == mode.fourcc);
  });
  if (usable.empty()) {
    return Error{(asked.format.empty()
                      ? "offers no format that can be read (" + knownFormats() + ")"
                      : "does not offer the format " + asked.format) +
                 "; it offers " + listFormats(offered)};
  }
  const bool size_asked = asked.width > 0 && asked.height > 0;
  std::optional<Candidate> best;
  for (const OfferedMode& mode : usable) {
    if (size_asked && !offersSize(mode, asked.width, asked.height)) continue;
    Candidate next = candidate(mode, asked);
    if (!best || better(next, *best, asked.rate_hz > 0.0)) best = std::move(next);
  }
  if (!best) return noSize(usable, asked);
  if (asked.rate_hz > 0.0 && !best->fast_enough) {
    best->mode.warnings.push_back("asked for " + rateText(asked.rate_hz) + " Hz, it gives " +
                                  rateText(best->mode.rate_hz) + " Hz at " +
                                  sizeText(best->mode.width, best->mode.height));
  }
  return best->mode;
}

}  // namespace waymark::capture
