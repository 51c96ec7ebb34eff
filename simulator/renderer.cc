#include "simulator/renderer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

#include "simulator/pixel_on_plane.h"
#include "simulator/plane_forms.h"
#include "simulator/random.h"

namespace waymark::simulator {
namespace {

constexpr float kNothing = 90.0F;  // grey level where a ray meets no surface

std::array<Eigen::Vector3d, 4> corners(const slam::Transform& T_c_s, double half_x, double half_y) {
  return {T_c_s * Eigen::Vector3d(-half_x, half_y, 0.0),
          T_c_s * Eigen::Vector3d(half_x, half_y, 0.0),
          T_c_s * Eigen::Vector3d(half_x, -half_y, 0.0),
          T_c_s * Eigen::Vector3d(-half_x, -half_y, 0.0)};
}

// Is all of the rectangle outside one side of the field of view, or behind the camera?
bool outOfView(const std::array<Eigen::Vector3d, 4>& p_c, const RayTable::Bounds& b) {
  const auto all = [&p_c](auto outside) { return std::all_of(p_c.begin(), p_c.end(), outside); };
  using P = Eigen::Vector3d;
  return all([](const P& p) { return p.z() <= 0.0; }) ||
         all([&](const P& p) { return p.x() < b.x_low * p.z(); }) ||
         all([&](const P& p) { return p.x() > b.x_high * p.z(); }) ||
         all([&](const P& p) { return p.y() < b.y_low * p.z(); }) ||
         all([&](const P& p) { return p.y() > b.y_high * p.z(); });
}

// A rolling shutter's poses at some of its rows, so close that between them nothing moves far; a
// global one's only pose.
std::vector<const slam::Transform*> samplePoses(const RowPoses& poses) {
  constexpr std::size_t kRows = 32;
  std::vector<const slam::Transform*> samples;
  for (std::size_t i = 0; i < poses.T_w_c.size(); i += kRows) samples.push_back(&poses.T_w_c[i]);
  if (samples.back() != &poses.T_w_c.back()) samples.push_back(&poses.T_w_c.back());
  return samples;
}

// How a surface lies before the camera while a row is read; empty where it is seen from its edge.
std::optional<PlaneForms> formsInRow(const Surface& s, const RowPoses& poses, int row) {
  const slam::Transform T_s_c = s.placeAt(poses.timeAt(row)).inverse() * poses.at(row);
  if (std::abs(T_s_c.p.z()) < kInPlane) return std::nullopt;
  return PlaneForms(T_s_c);
}

// Rows and columns of the ray table, ends excluded.
struct Box {
  int x_begin, x_end, y_begin, y_end;
};

// The pixels a paper can touch. Neighbouring rays are needed for sampling, so the outermost pixels
// of the table are left out.
Box boundingBox(const RowPoses& poses, const slam::Transform& T_w_m, double half_width,
                double half_height, const slam::CameraModel& camera, const RayTable& rays) {
  const Box whole{1, rays.width() - 1, 1, rays.height() - 1};
  // A straight edge bulges by the lens, and a rolling shutter shears it.
  const double slack = poses.T_w_c.size() == 1 ? 4.0 : 16.0;
  Eigen::Vector2d low(1e9, 1e9);
  Eigen::Vector2d high(-1e9, -1e9);
  for (const slam::Transform* T_w_c : samplePoses(poses)) {
    const slam::Transform T_c_m = T_w_c->inverse() * T_w_m;
    for (const double x : {-half_width, 0.0, half_width}) {
      for (const double y : {-half_height, 0.0, half_height}) {
        const auto pixel = camera.project(T_c_m * Eigen::Vector3d(x, y, 0.0));
        if (!pixel) return whole;
        low = low.cwiseMin(*pixel);
        high = high.cwiseMax(*pixel);
      }
    }
  }
  const auto column = [&](double x) {
    return static_cast<int>(std::lround(std::clamp(x + rays.margin(), 1.0, rays.width() - 1.0)));
  };
  const auto row = [&](double y) {
    return static_cast<int>(std::lround(std::clamp(y + rays.margin(), 1.0, rays.height() - 1.0)));
  };
  return {column(low.x() - slack), column(high.x() + slack), row(low.y() - slack),
          row(high.y() + slack)};
}

// The grey levels of a marker's paper, cell by cell, the white margin included.
struct MarkerPaper {
  int cells;  // along a side
  std::vector<float> grey;

  MarkerPaper(const slam::Dictionary& dictionary, int id) : cells(dictionary.cells() + 2) {
    grey.assign(static_cast<std::size_t>(cells) * static_cast<std::size_t>(cells),
                static_cast<float>(Renderer::kPaper));
    for (int r = 0; r < dictionary.cells(); ++r) {
      for (int c = 0; c < dictionary.cells(); ++c) {
        if (dictionary.white(id, r, c)) continue;
        grey[index(r + 1, c + 1)] = static_cast<float>(Renderer::kInk);
      }
    }
  }

  [[nodiscard]] std::size_t index(int row, int column) const {
    const int cell = row * cells + column;
    return static_cast<std::size_t>(cell);
  }
};

// The mean over a pixel of the paper where it is, and of `behind` where it is not.
float sampleMarker(const Gradient& u, const Gradient& v, const Gradient& w, float half,
                   const MarkerPaper& print, float behind) {
  const float per_cell = static_cast<float>(print.cells) / (2.0F * half);
  std::array<float, kSamples> column;
  std::array<float, kSamples> row;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const float z = 1.0F / w.at(k);
    column[k] = (u.at(k) * z + half) * per_cell;
    row[k] = (half - v.at(k) * z) * per_cell;
  }
  const auto cells = static_cast<float>(print.cells);
  float sum = 0.0F;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const bool hit = column[k] >= 0.0F && column[k] < cells && row[k] >= 0.0F && row[k] < cells;
    sum += hit ? print.grey[print.index(static_cast<int>(row[k]), static_cast<int>(column[k]))]
               : behind;
  }
  return sum / kSamples;
}

// What a pixel covers of a picture, in the picture's own pixels: how its place there changes to the
// next column and to the next row.
struct Footprint {
  Eigen::Vector2f by_column, by_row;

  // (u, v) of the surface's plane are u / w and v / w; per_x and per_y picture pixels a metre.
  Footprint(const Gradient& u, const Gradient& v, const Gradient& w, float per_x, float per_y) {
    const float z = 1.0F / w.centre;
    by_column = {(u.by_column - u.centre * z * w.by_column) * z * per_x,
                 (v.by_column - v.centre * z * w.by_column) * z * per_y};
    by_row = {(u.by_row - u.centre * z * w.by_row) * z * per_x,
              (v.by_row - v.centre * z * w.by_row) * z * per_y};
  }
  [[nodiscard]] float area() const {
    return std::abs(by_column.x() * by_row.y() - by_row.x() * by_column.y());
  }
};

// The mean over a pixel of a picture that fills it: four samples along the longer side of what the
// pixel covers, each reduced to the shorter one, between two levels.
float sampleFilling(const PrintedImage& image, float x, float y, const Footprint& footprint) {
  constexpr int kAlong = 4;
  const float column_length = footprint.by_column.norm();
  const float row_length = footprint.by_row.norm();
  const float longer = std::max(column_length, row_length);
  const Eigen::Vector2f step =
      (column_length > row_length ? footprint.by_column : footprint.by_row) / kAlong;
  const float shorter = footprint.area() / std::max(longer, 1e-6F);
  const float level = std::log2(std::max({shorter, longer / kAlong, 1.0F}));
  const int last = image.levels() - 1;
  const int fine = std::min(static_cast<int>(level), last);
  const int coarse = std::min(fine + 1, last);
  const float part = std::min(level - static_cast<float>(fine), 1.0F);
  float sum = 0.0F;
  for (int k = 0; k < kAlong; ++k) {
    const float along = static_cast<float>(k) - 0.5F * (kAlong - 1);
    const float sx = x + along * step.x();
    const float sy = y + along * step.y();
    const float at_fine = image.at(fine, sx, sy);
    sum += at_fine + part * (image.at(coarse, sx, sy) - at_fine);
  }
  return sum / kAlong;
}

// The same of a picture on paper.
float samplePrint(const Gradient& u, const Gradient& v, const Gradient& w, const Print& print,
                  float behind) {
  const auto half_width = static_cast<float>(0.5 * print.width_m);
  const auto half_height = static_cast<float>(0.5 * print.height_m);
  const PrintedImage& image = *print.image;
  const float per_x = static_cast<float>(image.width()) / (2.0F * half_width);
  const float per_y = static_cast<float>(image.height()) / (2.0F * half_height);
  std::array<float, kSamples> x;
  std::array<float, kSamples> y;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const float z = 1.0F / w.at(k);
    x[k] = u.at(k) * z;
    y[k] = v.at(k) * z;
  }
  // The picture's pixels between neighbouring samples: the pixel's area in them, by sixteen.
  const Footprint footprint(u, v, w, per_x, per_y);
  const int level = image.levelFor(std::sqrt(footprint.area() / kSamples));
  float sum = 0.0F;
  for (std::size_t k = 0; k < kSamples; ++k) {
    const bool hit = std::abs(x[k]) <= half_width && std::abs(y[k]) <= half_height;
    sum +=
        hit ? image.at(level, (x[k] + half_width) * per_x, (half_height - y[k]) * per_y) : behind;
  }
  return sum / kSamples;
}

}  // namespace

Result<Renderer> Renderer::create(const Scene& scene, std::uint64_t seed, int margin_px) {
  Result<RayTable> rays = RayTable::create(slam::CameraModel(scene.camera), margin_px);
  if (!rays) return rays.error();
  return Renderer(scene, seed, std::move(*rays));
}

Renderer::Renderer(const Scene& scene, std::uint64_t seed, RayTable rays)
    : dictionary_(scene.dictionary),
      camera_(scene.camera),
      rays_(std::move(rays)),
      surfaces_(scene.surfaces),
      has_images_(std::any_of(surfaces_.begin(), surfaces_.end(),
                              [](const Surface& surface) { return surface.image != nullptr; })),
      prints_(scene.prints) {
  Random random(seed, 0x5041494e54);
  for (Surface surface : surfaces_) {
    // Below an image the least of a texture will do: nobody sees it.
    if (surface.image != nullptr) {
      surface.paint = {.patches_per_m2 = 0.0, .texel_m = 2.0 * surface.half_width_m};
    }
    textures_.emplace_back(surface, random.next());
  }
}

void Renderer::render(const RowPoses& poses, std::span<const Marker> markers,
                      Workspace* workspace) const {
  const auto width = static_cast<std::size_t>(rays_.width());
  const std::size_t count = width * static_cast<std::size_t>(rays_.height());
  workspace->radiance.width = rays_.width();
  workspace->radiance.height = rays_.height();
  workspace->radiance.pixels.resize(count);
  workspace->inverse_depth.resize(count);
  workspace->surface.resize(count);
  workspace->u.resize(width);
  workspace->v.resize(width);

  renderSurfaces(poses, workspace);

  // Far ones first, so that near ones cover them.
  struct Paper {
    double distance2;
    const Marker* marker;  // or
    const Print* print;
  };
  const Eigen::Vector3d eye = poses.at(rays_.height() / 2).p;
  std::vector<Paper> far_first;
  for (const Print& print : prints_) {
    far_first.push_back({(print.T_w_p.p - eye).squaredNorm(), nullptr, &print});
  }
  for (const Marker& marker : markers) {
    far_first.push_back({(marker.T_w_m.p - eye).squaredNorm(), &marker, nullptr});
  }
  std::stable_sort(far_first.begin(), far_first.end(),
                   [](const Paper& a, const Paper& b) { return a.distance2 > b.distance2; });
  for (const Paper& paper : far_first) {
    if (paper.marker != nullptr) renderMarker(poses, *paper.marker, workspace);
    if (paper.print != nullptr) renderPrint(poses, *paper.print, workspace);
  }
}

void Renderer::renderSurfaces(const RowPoses& poses, Workspace* workspace) const {
  std::vector<int> candidates;
  for (std::size_t i = 0; i < surfaces_.size(); ++i) {
    const Surface& s = surfaces_[i];
    const auto checks = samplePoses(poses);
    const bool hidden =
        !s.motion && std::all_of(checks.begin(), checks.end(), [&](const slam::Transform* pose) {
          return outOfView(corners(pose->inverse() * s.T_w_s, s.half_width_m, s.half_height_m),
                           rays_.bounds());
        });
    if (!hidden) candidates.push_back(static_cast<int>(i));
  }
  for (int row = 0; row < rays_.height(); ++row) {
    renderSurfaceRow(row, poses, candidates, workspace);
    if (has_images_) renderImageRow(row, poses, candidates, workspace);
  }
  if (!has_images_) return;
  for (int row = 1; row + 1 < rays_.height(); ++row) renderOutlineRow(row, poses, workspace);
}

void Renderer::renderSurfaceRow(int row, const RowPoses& poses, std::span<const int> candidates,
                                Workspace* workspace) const {
  const auto width = static_cast<std::size_t>(rays_.width());
  const float* const x = rays_.x(row);
  const float* const y = rays_.y(row);
  float* const nearest = workspace->inverse_depth.data() + static_cast<std::size_t>(row) * width;
  int* const surface = workspace->surface.data() + static_cast<std::size_t>(row) * width;
  float* const u = workspace->u.data();
  float* const v = workspace->v.data();
  std::fill_n(nearest, width, 0.0F);
  std::fill_n(surface, width, -1);
  std::fill_n(u, width, 0.0F);
  std::fill_n(v, width, 0.0F);

  for (const int index : candidates) {
    const Surface& s = surfaces_[static_cast<std::size_t>(index)];
    const auto f = formsInRow(s, poses, row);
    if (!f) continue;
    const float a[3] = {f->u_over_z[0], f->u_over_z[1], f->u_over_z[2]};
    const float b[3] = {f->v_over_z[0], f->v_over_z[1], f->v_over_z[2]};
    const float c[3] = {f->inverse_z[0], f->inverse_z[1], f->inverse_z[2]};
    const auto half_u = static_cast<float>(s.half_width_m);
    const auto half_v = static_cast<float>(s.half_height_m);
    for (std::size_t i = 0; i < width; ++i) {
      const float uz = a[0] * x[i] + a[1] * y[i] + a[2];
      const float vz = b[0] * x[i] + b[1] * y[i] + b[2];
      const float w = c[0] * x[i] + c[1] * y[i] + c[2];
      // Without jumps, for vectors. NOLINTNEXTLINE(clang-diagnostic-bitwise-instead-of-logical)
      const bool hit =
          (w > nearest[i]) & (std::abs(uz) <= half_u * w) & (std::abs(vz) <= half_v * w);
      nearest[i] = hit ? w : nearest[i];
      surface[i] = hit ? index : surface[i];
      u[i] = hit ? uz : u[i];
      v[i] = hit ? vz : v[i];
    }
  }

  float* const out = workspace->radiance.row(row);
  for (std::size_t i = 0; i < width; ++i) {
    const float z = 1.0F / std::max(nearest[i], 1e-9F);
    u[i] *= z;
    v[i] *= z;
  }
  for (std::size_t i = 0; i < width; ++i) {
    out[i] =
        surface[i] < 0 ? kNothing : textures_[static_cast<std::size_t>(surface[i])].at(u[i], v[i]);
  }
}

void Renderer::renderImageRow(int row, const RowPoses& poses, std::span<const int> candidates,
                              Workspace* workspace) const {
  const int width = rays_.width();
  const int* const surface =
      workspace->surface.data() + static_cast<std::size_t>(row) * static_cast<std::size_t>(width);
  float* const out = workspace->radiance.row(row);
  for (const int index : candidates) {
    const Surface& s = surfaces_[static_cast<std::size_t>(index)];
    if (s.image == nullptr) continue;
    const auto forms = formsInRow(s, poses, row);
    if (!forms) continue;
    for (int i = 0; i < width; ++i) {
      if (surface[i] != index) continue;
      const PixelOnPlane pixel(*forms, rays_, i, row);
      const float z = 1.0F / pixel.w.centre;
      out[i] = sampleImage(s, pixel, pixel.u.centre * z, pixel.v.centre * z);
    }
  }
}

void Renderer::renderOutlineRow(int row, const RowPoses& poses, Workspace* workspace) const {
  const int width = rays_.width();
  const int* const surface = workspace->surface.data() + static_cast<std::ptrdiff_t>(row) * width;
  float* const out = workspace->radiance.row(row);
  std::vector<SurfaceInPixel>& there = workspace->outline;
  for (int i = 1; i + 1 < width; ++i) {
    const int middle = surface[i];
    if (surface[i - 1] == middle && surface[i + 1] == middle && surface[i - width] == middle &&
        surface[i + width] == middle) {
      continue;
    }
    there.clear();
    for (const int dy : {-1, 0, 1}) {
      for (const int dx : {-1, 0, 1}) {
        const int index = surface[i + dy * width + dx];
        const auto same = [index](const SurfaceInPixel& other) { return other.index == index; };
        if (index < 0 || std::any_of(there.begin(), there.end(), same)) continue;
        const auto forms = formsInRow(surfaces_[static_cast<std::size_t>(index)], poses, row);
        if (forms) there.push_back({index, PixelOnPlane(*forms, rays_, i, row)});
      }
    }
    out[i] = sampleOutline(there);
  }
}

float Renderer::sampleImage(const Surface& s, const PixelOnPlane& pixel, float u, float v) {
  const auto half_width = static_cast<float>(s.half_width_m);
  const auto half_height = static_cast<float>(s.half_height_m);
  const float per_x = static_cast<float>(s.image->width()) / (2.0F * half_width);
  const float per_y = static_cast<float>(s.image->height()) / (2.0F * half_height);
  return sampleFilling(*s.image, (u + half_width) * per_x, (half_height - v) * per_y,
                       {pixel.u, pixel.v, pixel.w, per_x, per_y});
}

float Renderer::sampleOutline(std::span<SurfaceInPixel> there) const {
  int nothing = 0;
  for (std::size_t k = 0; k < kSamples; ++k) {
    float nearest = 0.0F;
    SurfaceInPixel* seen = nullptr;
    for (SurfaceInPixel& candidate : there) {
      const Surface& s = surfaces_[static_cast<std::size_t>(candidate.index)];
      const float w = candidate.pixel.w.at(k);
      if (w <= nearest ||
          std::abs(candidate.pixel.u.at(k)) > static_cast<float>(s.half_width_m) * w ||
          std::abs(candidate.pixel.v.at(k)) > static_cast<float>(s.half_height_m) * w) {
        continue;
      }
      nearest = w;
      seen = &candidate;
    }
    if (seen == nullptr) {
      ++nothing;
      continue;
    }
    ++seen->samples;
    seen->u += seen->pixel.u.at(k) / nearest;
    seen->v += seen->pixel.v.at(k) / nearest;
  }
  float sum = static_cast<float>(nothing) * kNothing;
  for (const SurfaceInPixel& part : there) {
    if (part.samples == 0) continue;
    const auto index = static_cast<std::size_t>(part.index);
    const auto samples = static_cast<float>(part.samples);
    const float u = part.u / samples;
    const float v = part.v / samples;
    sum += samples * (surfaces_[index].image != nullptr
                          ? sampleImage(surfaces_[index], part.pixel, u, v)
                          : textures_[index].at(u, v));
  }
  return sum / kSamples;
}

void Renderer::renderMarker(const RowPoses& poses, const Marker& marker,
                            Workspace* workspace) const {
  const MarkerPaper paper(dictionary_, marker.id);
  const double half_paper = 0.5 * marker.size_m * paper.cells / dictionary_.cells();
  const auto half = static_cast<float>(half_paper);
  renderPaper(poses, marker.T_w_m, half_paper, half_paper, workspace,
              [&](const Gradient& u, const Gradient& v, const Gradient& w, float behind) {
                return sampleMarker(u, v, w, half, paper, behind);
              });
}

void Renderer::renderPrint(const RowPoses& poses, const Print& print, Workspace* workspace) const {
  renderPaper(poses, print.T_w_p, 0.5 * print.width_m, 0.5 * print.height_m, workspace,
              [&](const Gradient& u, const Gradient& v, const Gradient& w, float behind) {
                return samplePrint(u, v, w, print, behind);
              });
}

template <typename Sample>
void Renderer::renderPaper(const RowPoses& poses, const slam::Transform& T_w_m, double half_width_m,
                           double half_height_m, Workspace* workspace, const Sample& sample) const {
  const slam::Transform T_m_w = T_w_m.inverse();
  const auto seen = [&](const slam::Transform* T_w_c) {
    return (T_m_w * *T_w_c).p.z() > kInPlane &&
           !outOfView(corners(T_w_c->inverse() * T_w_m, half_width_m, half_height_m),
                      rays_.bounds());
  };
  const auto checks = samplePoses(poses);
  if (std::none_of(checks.begin(), checks.end(), seen)) return;

  const auto half_width = static_cast<float>(half_width_m);
  const auto half_height = static_cast<float>(half_height_m);
  const Box box = boundingBox(poses, T_w_m, half_width_m, half_height_m, camera_, rays_);
  const auto width = static_cast<std::size_t>(rays_.width());
  for (int row = box.y_begin; row < box.y_end; ++row) {
    const slam::Transform T_m_c = T_m_w * poses.at(row);
    if (T_m_c.p.z() <= kInPlane) continue;
    const PlaneForms forms(T_m_c);
    const float* const depth =
        workspace->inverse_depth.data() + static_cast<std::size_t>(row) * width;
    float* const out = workspace->radiance.row(row);
    for (int i = box.x_begin; i < box.x_end; ++i) {
      // The lens is so nearly linear within a pixel that its derivative places the samples to
      // 0.0002 px.
      const PixelOnPlane pixel(forms, rays_, i, row);
      const auto& [u, v, w] = pixel;
      const float nearest = w.centre + w.reach();
      if (w.centre <= w.reach() || std::abs(u.centre) - u.reach() > half_width * nearest ||
          std::abs(v.centre) - v.reach() > half_height * nearest) {
        continue;
      }
      if (w.centre < depth[i] * (1.0F - 1e-5F)) continue;  // behind a wall
      out[i] = sample(u, v, w, out[i]);
    }
  }
}

}  // namespace waymark::simulator
