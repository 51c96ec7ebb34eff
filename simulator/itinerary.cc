#include "simulator/itinerary.h"

#include <numbers>

namespace waymark::simulator {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;

}  // namespace

Itinerary::Itinerary(const Stop& start) : at_(start) {}

Itinerary& Itinerary::add(const Stop& to, int beats, double liveliness) {
  for (int i = 0; i < beats; ++i) {
    const double part = static_cast<double>(i) / beats;
    knots_.emplace_back(at_.x_m + part * (to.x_m - at_.x_m), at_.y_m + part * (to.y_m - at_.y_m),
                        kRadPerDeg * (at_.yaw_deg + part * (to.yaw_deg - at_.yaw_deg)), liveliness);
  }
  at_ = to;
  return *this;
}

Itinerary& Itinerary::go(const Stop& to, int beats) { return add(to, beats, 1.0); }

Itinerary& Itinerary::goStill(const Stop& to, int beats) { return add(to, beats, 0.0); }

Itinerary::Path Itinerary::path() const {
  const Eigen::Vector4d turn(0.0, 0.0, kRadPerDeg * at_.yaw_deg - knots_.front().z(), 0.0);
  return {ClosedSpline(knots_, turn), duration_s()};
}

View Itinerary::Path::at(double time_s, double height_m) const {
  const Eigen::Vector4d now = spline_.at(time_s / duration_s_);
  return {{now.x(), now.y(), height_m}, now.z(), 0.0, 0.0};
}

double Itinerary::Path::liveliness(double time_s) const {
  return spline_.at(time_s / duration_s_).w();
}

View swayed(const View& view, const Sway& sway, double share, double time_s) {
  const View offset = sway.apply({}, time_s);
  return {view.position + share * offset.position, view.yaw + share * offset.yaw,
          view.pitch + share * offset.pitch, view.roll + share * offset.roll};
}

}  // namespace waymark::simulator
