#include "io/maps/map_picture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>
#include <utility>

#include <Eigen/Geometry>

#include "io/text/number_text.h"
#include "io/text/text_file.h"
#include "slam/geometry/robust.h"

namespace waymark::io {
namespace {

// Sizes in SVG units, which are pixels at the natural size.
constexpr double kDrawing = 900.0;   // the longer side of what is drawn
constexpr double kShortest = 320.0;  // the shorter side is padded to at least this
constexpr double kMargin = 62.0;
constexpr double kHeader = 64.0;
constexpr double kFooter = 40.0;

constexpr std::string_view kInk = "#1f2933";
constexpr std::string_view kMuted = "#7b8794";
constexpr std::string_view kGrid = "#eceff3";
constexpr std::string_view kMarkerFill = "#f6c65b";
constexpr std::string_view kMarkerEdge = "#a8670a";
constexpr std::string_view kEstimate = "#2563eb";
constexpr std::string_view kTruth = "#10b981";

std::string n(double value) { return fixed(value, 2); }

std::string quoted(std::string_view text) {
  std::string escaped;
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

// The largest of 1, 2, 5 x 10^k that is at most `value`.
double roundLength(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double step : {5.0, 2.0}) {
    if (step * power <= value) return step * power;
  }
  return power;
}

std::string lengthText(double metres) {
  if (metres >= 1.0) return fixed(metres, 0) + " m";
  if (metres >= 0.01) return fixed(100.0 * metres, 0) + " cm";
  return fixed(1000.0 * metres, 0) + " mm";
}

// Where the world is cut flat: which world axes go right and up on the page, and how far.
class Projection {
 public:
  explicit Projection(const MapPicture& picture) {
    Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
    Eigen::Vector3d high = -low;
    const auto include = [&](const Eigen::Vector3d& p) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    };
    for (const MarkerCorners& marker : picture.markers) {
      for (const Eigen::Vector3d& corner : marker.corners) include(corner);
    }
    for (const Trajectory* trajectory : {&picture.estimate, &picture.truth}) {
      for (const StampedPose& pose : *trajectory) include(pose.T_w_c.p);
    }
    if (!low.allFinite()) low = high = Eigen::Vector3d::Zero();
    chooseAxes(high - low, picture.z_is_up);
    fit(low, high);
  }

  [[nodiscard]] Eigen::Vector2d operator()(const Eigen::Vector3d& p) const {
    return {left_ + scale_ * (p[right_axis_] - origin_.x()),
            top_ + scale_ * (origin_.y() - up_sign_ * p[up_axis_])};
  }
  // A direction on the page, y down; not scaled.
  [[nodiscard]] Eigen::Vector2d direction(const Eigen::Vector3d& v) const {
    return {v[right_axis_], -up_sign_ * v[up_axis_]};
  }
  [[nodiscard]] double scale() const { return scale_; }  // SVG units per metre
  [[nodiscard]] double width() const { return width_; }
  [[nodiscard]] double height() const { return height_; }
  [[nodiscard]] std::string axesText() const {
    constexpr std::array<std::string_view, 3> kNames = {"x", "y", "z"};
    return std::string(kNames[static_cast<std::size_t>(right_axis_)]) + " to the right, " +
           std::string(kNames[static_cast<std::size_t>(up_axis_)]) +
           (up_sign_ > 0.0 ? " up" : " down");
  }

 private:
  void chooseAxes(const Eigen::Vector3d& extent, bool z_is_up) {
    struct View {
      int right;
      int up;
      double up_sign;
    };
    // By the axis looked along; none of them mirrors the world.
    constexpr std::array<View, 3> kZUp = {{{1, 2, 1.0}, {0, 2, 1.0}, {0, 1, 1.0}}};
    constexpr std::array<View, 3> kCamera = {{{2, 1, -1.0}, {0, 2, 1.0}, {0, 1, -1.0}}};
    std::size_t least = 0;
    extent.minCoeff(&least);
    const View& view = (z_is_up ? kZUp : kCamera)[least];
    right_axis_ = view.right;
    up_axis_ = view.up;
    up_sign_ = view.up_sign;
  }

  void fit(const Eigen::Vector3d& low, const Eigen::Vector3d& high) {
    const double up_low = std::min(up_sign_ * low[up_axis_], up_sign_ * high[up_axis_]);
    const double up_high = std::max(up_sign_ * low[up_axis_], up_sign_ * high[up_axis_]);
    const double wide = high[right_axis_] - low[right_axis_];
    const double tall = up_high - up_low;
    const double longer = std::max({wide, tall, 1e-3});
    scale_ = kDrawing / longer;
    const double drawn_width = std::max(scale_ * wide, kShortest);
    const double drawn_height = std::max(scale_ * tall, kShortest);
    width_ = drawn_width + 2.0 * kMargin;
    height_ = drawn_height + 2.0 * kMargin + kHeader + kFooter;
    left_ = kMargin + 0.5 * (drawn_width - scale_ * wide);
    top_ = kMargin + kHeader + 0.5 * (drawn_height - scale_ * tall);
    origin_ = {low[right_axis_], up_high};
  }

  int right_axis_ = 0;
  int up_axis_ = 2;
  double up_sign_ = 1.0;
  double scale_ = 1.0;
  double width_ = 0.0;
  double height_ = 0.0;
  double left_ = 0.0;
  double top_ = 0.0;
  Eigen::Vector2d origin_;  // world coordinates (right, up) of the drawing's top-left
};

std::string line(const Eigen::Vector2d& a, const Eigen::Vector2d& b, std::string_view colour,
                 double width) {
  return "<line x1=\"" + n(a.x()) + "\" y1=\"" + n(a.y()) + "\" x2=\"" + n(b.x()) + "\" y2=\"" +
         n(b.y()) + "\" stroke=\"" + std::string(colour) + "\" stroke-width=\"" + n(width) +
         "\" stroke-linecap=\"round\"/>\n";
}

std::string text(const Eigen::Vector2d& at, std::string_view content, double size,
                 std::string_view colour, std::string_view extra = "") {
  return "<text x=\"" + n(at.x()) + "\" y=\"" + n(at.y()) + "\" font-size=\"" + n(size) +
         "\" fill=\"" + std::string(colour) + "\" " + std::string(extra) + ">" + quoted(content) +
         "</text>\n";
}

std::string grid(const Projection& project) {
  const double step =
      roundLength(std::max(project.width(), project.height()) / 6.0 / project.scale()) *
      project.scale();
  const double top = kHeader;
  const double bottom = project.height() - kFooter;
  const Eigen::Vector2d zero = project(Eigen::Vector3d::Zero());
  std::string svg;
  // The lines of the grid within [from, to), one of them through `through`.
  const auto places = [step](double from, double to, double through) {
    const auto first = std::lround(std::ceil((from - through) / step));
    std::vector<double> on_lines;
    for (auto i = first; through + i * step < to; ++i) on_lines.push_back(through + i * step);
    return on_lines;
  };
  for (const double x : places(0.0, project.width(), zero.x())) {
    svg += line({x, top}, {x, bottom}, kGrid, 1.0);
  }
  for (const double y : places(top, bottom, zero.y())) {
    svg += line({0.0, y}, {project.width(), y}, kGrid, 1.0);
  }
  return svg;
}

// Keeps labels off each other: one that would cover another moves on along its way out.
class LabelPlaces {
 public:
  Eigen::Vector2d find(Eigen::Vector2d at, const Eigen::Vector2d& way_out) {
    constexpr int kTries = 8;
    for (int i = 0; i < kTries && covered(at); ++i) at += kHeight * way_out;
    places_.push_back(at);
    return at;
  }

 private:
  static constexpr double kWidth = 20.0;
  static constexpr double kHeight = 11.0;

  [[nodiscard]] bool covered(const Eigen::Vector2d& at) const {
    return std::any_of(places_.begin(), places_.end(), [&](const Eigen::Vector2d& place) {
      const Eigen::Vector2d distance = (place - at).cwiseAbs();
      return distance.x() < kWidth && distance.y() < kHeight - 1.0;
    });
  }

  std::vector<Eigen::Vector2d> places_;
};

// The projected print; a marker seen edge-on is a bar. A short line shows where it faces.
std::string markerShape(const Projection& project, const MarkerCorners& marker,
                        LabelPlaces& labels) {
  std::string points;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double twice_area = 0.0;
  double longest_side = 1e-9;
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d p = project(marker.corners[i]);
    const Eigen::Vector2d next = project(marker.corners[(i + 1) % 4]);
    points += (points.empty() ? "" : " ") + n(p.x()) + "," + n(p.y());
    centre += 0.25 * p;
    twice_area += p.x() * next.y() - p.y() * next.x();
    longest_side = std::max(longest_side, (next - p).norm());
  }
  const Eigen::Vector3d normal = (marker.corners[1] - marker.corners[0])
                                     .cross(marker.corners[0] - marker.corners[3])
                                     .normalized();
  const Eigen::Vector2d facing = project.direction(normal);
  const bool edge_on = facing.norm() > 0.3;
  std::string svg;
  if (edge_on) {
    const double reach = std::clamp(0.5 * marker.size_m * project.scale(), 6.0, 18.0);
    svg += line(centre, centre + reach * facing, kMarkerEdge, 1.2);
  }
  svg += "<polygon points=\"" + points + "\" fill=\"" + std::string(kMarkerFill) + "\" stroke=\"" +
         std::string(kMarkerEdge) + "\" stroke-width=\"1.8\" stroke-linejoin=\"round\"/>\n";

  // The id: inside where there is room, else behind the marker.
  const std::string id = std::to_string(marker.id);
  const double room = 0.5 * std::abs(twice_area) / longest_side;
  if (room > 13.0) {
    const double size = std::clamp(0.45 * room, 8.0, 16.0);
    return svg + text(centre + Eigen::Vector2d(0.0, 0.36 * size), id, size, kInk,
                      "text-anchor=\"middle\"");
  }
  const Eigen::Vector2d away =
      edge_on ? Eigen::Vector2d(-facing.normalized()) : Eigen::Vector2d(0, -1);
  const Eigen::Vector2d at = labels.find(centre + 12.0 * away, away);
  return svg + text(at + Eigen::Vector2d(0.0, 3.6), id, 10.0, kInk, "text-anchor=\"middle\"");
}

std::int64_t medianPeriod(const Trajectory& trajectory) {
  std::vector<std::int64_t> periods;
  for (std::size_t i = 1; i < trajectory.size(); ++i) {
    periods.push_back(trajectory[i].time_ns - trajectory[i - 1].time_ns);
  }
  return periods.empty() ? 0 : slam::median(std::move(periods));
}

// A solid line per stretch without a missing frame; gaps are dotted and thin.
std::string trajectoryPath(const Projection& project, const Trajectory& trajectory,
                           std::string_view colour, double width) {
  std::string solid;
  std::string dotted;
  const std::int64_t max_ns = 5 * medianPeriod(trajectory) / 2;
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    const Eigen::Vector2d p = project(trajectory[i].T_w_c.p);
    const std::string place = n(p.x()) + " " + n(p.y());
    const bool gap = i > 0 && trajectory[i].time_ns - trajectory[i - 1].time_ns > max_ns;
    if (gap) {
      const Eigen::Vector2d before = project(trajectory[i - 1].T_w_c.p);
      dotted += "M" + n(before.x()) + " " + n(before.y()) + "L" + place;
    }
    solid += (i == 0 || gap ? "M" : "L") + place;
  }
  const std::string stroke = "fill=\"none\" stroke=\"" + std::string(colour) +
                             "\" stroke-linejoin=\"round\" stroke-linecap=\"round\" ";
  std::string svg = "<path d=\"" + solid + "\" " + stroke + "stroke-width=\"" + n(width) + "\"/>\n";
  if (!dotted.empty()) {
    svg += "<path d=\"" + dotted + "\" " + stroke +
           "stroke-width=\"1\" stroke-dasharray=\"1 4\" opacity=\"0.7\"/>\n";
  }
  return svg;
}

std::string dot(const Eigen::Vector2d& at, std::string_view fill, std::string_view edge) {
  return "<circle cx=\"" + n(at.x()) + "\" cy=\"" + n(at.y()) + "\" r=\"5\" fill=\"" +
         std::string(fill) + "\" stroke=\"" + std::string(edge) + "\" stroke-width=\"2\"/>\n";
}

// The end of a long title says more than its beginning: it is a file's name.
std::string shortened(const std::string& title, double width) {
  constexpr double kCharacter = 11.5;  // of the bold font at this size, in the mean
  const auto room = static_cast<std::size_t>(width / kCharacter);
  if (title.size() <= room) return title;
  std::size_t from = title.size() - room + 3;
  // Not within a character of several bytes.
  while (from < title.size() && (static_cast<unsigned char>(title[from]) & 0xC0U) == 0x80U) ++from;
  return "..." + title.substr(from);
}

std::string header(const Projection& project, const MapPicture& picture) {
  const std::string title = shortened(picture.title, project.width() - 2.0 * kMargin);
  return text({kMargin, 30.0}, title, 18.0, kInk, "font-weight=\"600\"") +
         text({kMargin, 50.0},
              std::to_string(picture.markers.size()) + " markers, " +
                  std::to_string(picture.estimate.size()) + " poses; " + project.axesText(),
              12.0, kMuted);
}

// What the lines are, left; the scale bar, right.
std::string footer(const Projection& project, const MapPicture& picture) {
  const double y = project.height() - 16.0;
  double x = kMargin;
  std::string svg;
  const auto entry = [&](std::string_view label, std::string_view colour, double width) {
    svg += line({x, y - 4.0}, {x + 22.0, y - 4.0}, colour, width);
    svg += text({x + 29.0, y}, label, 12.0, kInk);
    x += 100.0;
  };
  if (!picture.truth.empty()) entry("truth", kTruth, 5.0);
  if (picture.photographs) {
    svg +=
        dot({x + 6.0, y - 4.0}, kEstimate, kEstimate) + text({x + 17.0, y}, "camera", 12.0, kInk);
  } else if (!picture.estimate.empty()) {
    entry("estimate", kEstimate, 2.0);
    svg += dot({x + 6.0, y - 4.0}, "#ffffff", kEstimate) + text({x + 17.0, y}, "start", 12.0, kInk);
    svg += dot({x + 71.0, y - 4.0}, kEstimate, kEstimate) + text({x + 82.0, y}, "end", 12.0, kInk);
  }
  const double metres = roundLength(0.2 * project.width() / project.scale());
  const double end = project.width() - kMargin;
  const double start = end - metres * project.scale();
  for (const double tick : {start, end}) svg += line({tick, y - 8.0}, {tick, y}, kInk, 1.6);
  svg += line({start, y - 4.0}, {end, y - 4.0}, kInk, 1.6);
  return svg + text({start - 8.0, y}, lengthText(metres), 12.0, kInk, "text-anchor=\"end\"");
}

}  // namespace

std::string formatMapPicture(const MapPicture& picture) {
  const Projection project(picture);
  const std::string width = n(project.width());
  const std::string height = n(project.height());
  std::string svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + width + "\" height=\"" +
                    height + "\" viewBox=\"0 0 " + width + " " + height +
                    "\" font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\">\n";
  svg += "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n";
  svg += grid(project);
  if (!picture.truth.empty()) svg += trajectoryPath(project, picture.truth, kTruth, 5.0);
  LabelPlaces labels;
  for (const MarkerCorners& marker : picture.markers) svg += markerShape(project, marker, labels);
  if (picture.photographs) {
    for (const StampedPose& pose : picture.estimate) {
      svg += dot(project(pose.T_w_c.p), kEstimate, kEstimate);
    }
  } else if (!picture.estimate.empty()) {
    svg += trajectoryPath(project, picture.estimate, kEstimate, 2.0);
    svg += dot(project(picture.estimate.front().T_w_c.p), "#ffffff", kEstimate);
    svg += dot(project(picture.estimate.back().T_w_c.p), kEstimate, kEstimate);
  }
  svg += header(project, picture) + footer(project, picture);
  return svg + "</svg>\n";
}

Status writeMapPicture(const std::filesystem::path& path, const MapPicture& picture) {
  return writeTextFile(path, formatMapPicture(picture));
}

}  // namespace waymark::io
