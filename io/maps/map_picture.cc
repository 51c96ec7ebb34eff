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
constexpr double kTitle = 34.0;         // above the first of several pieces
constexpr double kOtherPieces = 600.0;  // as kDrawing, of those after the first

constexpr std::string_view kInk = "#1f2933";
constexpr std::string_view kMuted = "#7b8794";
constexpr std::string_view kGrid = "#eceff3";
constexpr std::string_view kMarkerFill = "#f6c65b";
constexpr std::string_view kMarkerEdge = "#a8670a";
constexpr std::string_view kNaturalFill = "#e6dcf3";
constexpr std::string_view kNaturalEdge = "#6f4a9e";
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
  // The longer side of what is drawn gets `drawn`.
  Projection(const MapDrawing& drawing, bool z_is_up, double drawn) {
    Eigen::Vector3d low = Eigen::Vector3d::Constant(std::numeric_limits<double>::infinity());
    Eigen::Vector3d high = -low;
    const auto include = [&](const Eigen::Vector3d& p) {
      low = low.cwiseMin(p);
      high = high.cwiseMax(p);
    };
    for (const MarkerCorners& marker : drawing.markers) {
      for (const Eigen::Vector3d& corner : marker.corners) include(corner);
    }
    for (const NaturalMarkerCorners& marker : drawing.natural) {
      for (const Eigen::Vector3d& corner : marker.corners) include(corner);
    }
    for (const Trajectory* trajectory : {&drawing.estimate, &drawing.truth}) {
      for (const StampedPose& pose : *trajectory) include(pose.T_w_c.p);
    }
    if (!low.allFinite()) low = high = Eigen::Vector3d::Zero();
    chooseAxes(high - low, z_is_up);
    fit(low, high, drawn);
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

  void fit(const Eigen::Vector3d& low, const Eigen::Vector3d& high, double drawn) {
    const double up_low = std::min(up_sign_ * low[up_axis_], up_sign_ * high[up_axis_]);
    const double up_high = std::max(up_sign_ * low[up_axis_], up_sign_ * high[up_axis_]);
    const double wide = high[right_axis_] - low[right_axis_];
    const double tall = up_high - up_low;
    const double longer = std::max({wide, tall, 1e-3});
    scale_ = drawn / longer;
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
  static constexpr double kWidth = 20.0;  // of an id

  Eigen::Vector2d find(Eigen::Vector2d at, const Eigen::Vector2d& way_out, double width = kWidth) {
    constexpr int kTries = 8;
    for (int i = 0; i < kTries && covered(at, width); ++i) at += kHeight * way_out;
    places_.push_back({at, width});
    return at;
  }

 private:
  struct Place {
    Eigen::Vector2d at;
    double width;
  };
  static constexpr double kHeight = 11.0;

  [[nodiscard]] bool covered(const Eigen::Vector2d& at, double width) const {
    return std::any_of(places_.begin(), places_.end(), [&](const Place& place) {
      const Eigen::Vector2d distance = (place.at - at).cwiseAbs();
      return distance.x() < 0.5 * (place.width + width) && distance.y() < kHeight - 1.0;
    });
  }

  std::vector<Place> places_;
};

// A print as it lies on the page.
class Print {
 public:
  Print(const Projection& project, const std::array<Eigen::Vector3d, 4>& corners) {
    double twice_area = 0.0;
    double longest_side = 1e-9;
    for (std::size_t i = 0; i < 4; ++i) {
      const Eigen::Vector2d p = project(corners[i]);
      const Eigen::Vector2d next = project(corners[(i + 1) % 4]);
      points_ += (points_.empty() ? "" : " ") + n(p.x()) + "," + n(p.y());
      centre_ += 0.25 * p;
      twice_area += p.x() * next.y() - p.y() * next.x();
      longest_side = std::max(longest_side, (next - p).norm());
      box_.extend(p);
    }
    room_ = 0.5 * std::abs(twice_area) / longest_side;
    facing_ =
        project.direction((corners[1] - corners[0]).cross(corners[0] - corners[3]).normalized());
  }

  // Seen edge-on it is a bar, and a short line shows where it faces.
  [[nodiscard]] std::string shape(double reach, std::string_view fill,
                                  std::string_view edge) const {
    std::string svg;
    if (edgeOn()) svg += line(centre_, centre_ + reach * facing_, edge, 1.2);
    return svg + "<polygon points=\"" + points_ + "\" fill=\"" + std::string(fill) +
           "\" stroke=\"" + std::string(edge) +
           "\" stroke-width=\"1.8\" stroke-linejoin=\"round\"/>\n";
  }
  // Inside where there is room.
  [[nodiscard]] std::string labelInside(std::string_view content, double size) const {
    return text(centre_ + Eigen::Vector2d(0.0, 0.36 * size), content, size, kInk,
                "text-anchor=\"middle\"");
  }
  // Behind it where it is seen edge-on, else above its middle.
  [[nodiscard]] Eigen::Vector2d away() const {
    return edgeOn() ? Eigen::Vector2d(-facing_.normalized()) : Eigen::Vector2d(0, -1);
  }
  [[nodiscard]] const Eigen::Vector2d& centre() const { return centre_; }
  [[nodiscard]] double room() const { return room_; }  // how wide it is where it is narrow
  [[nodiscard]] double wide() const { return box_.sizes().x(); }
  // From its centre as far as its box goes.
  [[nodiscard]] double reach(const Eigen::Vector2d& way) const {
    return 0.5 * box_.sizes().dot(way.cwiseAbs());
  }

 private:
  [[nodiscard]] bool edgeOn() const { return facing_.norm() > 0.3; }

  std::string points_;
  Eigen::Vector2d centre_ = Eigen::Vector2d::Zero();
  Eigen::AlignedBox2d box_;
  double room_ = 0.0;
  Eigen::Vector2d facing_;  // shorter the less it is seen from the side
};

std::string labelText(const Eigen::Vector2d& at, std::string_view content) {
  return text(at + Eigen::Vector2d(0.0, 3.6), content, 10.0, kInk, "text-anchor=\"middle\"");
}

// Inside a print that has so much room.
double labelSize(double room) { return std::clamp(0.45 * room, 8.0, 16.0); }

std::string markerShape(const Projection& project, const MarkerCorners& marker,
                        LabelPlaces& labels) {
  const Print print(project, marker.corners);
  const double reach = std::clamp(0.5 * marker.size_m * project.scale(), 6.0, 18.0);
  const std::string svg = print.shape(reach, kMarkerFill, kMarkerEdge);
  const std::string id = std::to_string(marker.id);
  if (print.room() > 13.0) {
    return svg + print.labelInside(id, labelSize(print.room()));
  }
  return svg + labelText(labels.find(print.centre() + 12.0 * print.away(), print.away()), id);
}

// The beginning of a long name.
std::string shortName(const std::string& name) {
  constexpr std::size_t kMost = 24;
  std::string whole = oneLine(name);
  if (whole.size() <= kMost) return whole;
  std::size_t end = kMost - 3;
  while (end > 0 && (static_cast<unsigned char>(whole[end]) & 0xC0U) == 0x80U) --end;
  return whole.substr(0, end) + "...";
}

// Names are longer than ids: smaller inside, and beside it so that they do not lie across.
std::string naturalShape(const Projection& project, const NaturalMarkerCorners& marker,
                         LabelPlaces& labels) {
  constexpr double kCharacter = 0.62;  // of the font's size, in the mean
  constexpr double kSmallest = 8.0;
  const Print print(project, marker.corners);
  const double width_m = (marker.corners[1] - marker.corners[0]).norm();
  const double reach = std::clamp(0.25 * width_m * project.scale(), 6.0, 18.0);
  const std::string svg = print.shape(reach, kNaturalFill, kNaturalEdge);
  const std::string name = shortName(marker.name);
  const double characters = std::max<double>(1.0, static_cast<double>(name.size()));
  const double fits = 0.9 * print.wide() / (kCharacter * characters);
  if (print.room() > 13.0 && fits >= kSmallest) {
    return svg + print.labelInside(name, std::min(fits, labelSize(print.room())));
  }
  const double width = std::max(kCharacter * 10.0 * characters, LabelPlaces::kWidth);
  const Eigen::Vector2d away = print.away();
  const double distance = print.reach(away) + 8.0 + 0.5 * width * std::abs(away.x());
  Eigen::Vector2d at = print.centre() + distance * away;
  at.x() = std::clamp(at.x(), 0.5 * width + 4.0, project.width() - 0.5 * width - 4.0);
  return svg + labelText(labels.find(at, away, width), name);
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

std::string header(const Projection& project, const MapDrawing& drawing, const std::string& title,
                   double size) {
  std::string counts = std::to_string(drawing.markers.size()) + " markers, ";
  if (!drawing.natural.empty()) {
    counts += std::to_string(drawing.natural.size()) + " natural ones (violet), ";
  }
  counts += std::to_string(drawing.estimate.size()) + " poses; " + project.axesText();
  return text({kMargin, 30.0}, shortened(title, project.width() - 2.0 * kMargin), size, kInk,
              "font-weight=\"600\"") +
         text({kMargin, 50.0}, counts, 12.0, kMuted);
}

// What the lines are, left; the scale bar, right.
std::string footer(const Projection& project, const MapDrawing& drawing, bool photographs) {
  const double y = project.height() - 16.0;
  double x = kMargin;
  std::string svg;
  const auto entry = [&](std::string_view label, std::string_view colour, double width) {
    svg += line({x, y - 4.0}, {x + 22.0, y - 4.0}, colour, width);
    svg += text({x + 29.0, y}, label, 12.0, kInk);
    x += 100.0;
  };
  if (!drawing.truth.empty()) entry("truth", kTruth, 5.0);
  if (photographs) {
    svg +=
        dot({x + 6.0, y - 4.0}, kEstimate, kEstimate) + text({x + 17.0, y}, "camera", 12.0, kInk);
  } else if (!drawing.estimate.empty()) {
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

// All of a piece but its title, from the top left corner of the page.
std::string drawn(const Projection& project, const MapDrawing& drawing, bool photographs) {
  std::string svg = grid(project);
  if (!drawing.truth.empty()) svg += trajectoryPath(project, drawing.truth, kTruth, 5.0);
  LabelPlaces labels;
  for (const NaturalMarkerCorners& marker : drawing.natural) {
    svg += naturalShape(project, marker, labels);
  }
  for (const MarkerCorners& marker : drawing.markers) svg += markerShape(project, marker, labels);
  if (photographs) {
    for (const StampedPose& pose : drawing.estimate) {
      svg += dot(project(pose.T_w_c.p), kEstimate, kEstimate);
    }
  } else if (!drawing.estimate.empty()) {
    svg += trajectoryPath(project, drawing.estimate, kEstimate, 2.0);
    svg += dot(project(drawing.estimate.front().T_w_c.p), "#ffffff", kEstimate);
    svg += dot(project(drawing.estimate.back().T_w_c.p), kEstimate, kEstimate);
  }
  return svg;
}

std::string page(double width, double height, const std::string& content) {
  const std::string w = n(width);
  const std::string h = n(height);
  return "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"" + w + "\" height=\"" + h +
         "\" viewBox=\"0 0 " + w + " " + h +
         "\" font-family=\"DejaVu Sans, Helvetica, Arial, sans-serif\">\n" +
         "<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n" + content + "</svg>\n";
}

std::string onePiece(const MapPicture& picture) {
  const MapDrawing& drawing = picture.pieces.front();
  const Projection project(drawing, picture.z_is_up, kDrawing);
  return page(project.width(), project.height(),
              drawn(project, drawing, picture.photographs) +
                  header(project, drawing, picture.title, 18.0) +
                  footer(project, drawing, picture.photographs));
}

// Each has its own world, and nobody knows how they lie to each other.
std::string severalPieces(const MapPicture& picture) {
  std::string content;
  double width = 0.0;
  double height = kTitle;
  for (const MapDrawing& drawing : picture.pieces) {
    const bool first = &drawing == &picture.pieces.front();
    const Projection project(drawing, picture.z_is_up, first ? kDrawing : kOtherPieces);
    content += "<g transform=\"translate(0 " + n(height) + ")\">\n" +
               drawn(project, drawing, picture.photographs) +
               header(project, drawing, "piece " + std::to_string(drawing.piece), 15.0) +
               footer(project, drawing, picture.photographs) + "</g>\n";
    width = std::max(width, project.width());
    height += project.height();
  }
  content += text({kMargin, 30.0}, shortened(picture.title, width - 2.0 * kMargin), 18.0, kInk,
                  "font-weight=\"600\"");
  return page(width, height, content);
}

}  // namespace

std::string formatMapPicture(const MapPicture& picture) {
  return picture.pieces.size() == 1 ? onePiece(picture) : severalPieces(picture);
}

Status writeMapPicture(const std::filesystem::path& path, const MapPicture& picture) {
  return writeTextFile(path, formatMapPicture(picture));
}

}  // namespace waymark::io
