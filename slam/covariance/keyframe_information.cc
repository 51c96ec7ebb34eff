#include "slam/covariance/keyframe_information.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <Eigen/LU>

#include "slam/covariance/corner_sums.h"
#include "slam/geometry/reprojection.h"
#include "slam/geometry/robust.h"
#include "slam/geometry/small_cholesky.h"
#include "slam/geometry/turned_covariance.h"
#include "slam/optimization/block_kernels.h"
#include "slam/optimization/bundle_adjuster.h"

namespace waymark::slam {
namespace {

// A keyframe's view of a marker.
struct LinearizedView {
  int index = 0;  // of the unknown ones; less than 0 for one that is fixed
  Matrix6d information = Matrix6d::Zero();  // A: of the marker, the camera held
  Vector6d gradient = Vector6d::Zero();     // g = J^T W r: of half the squared residuals
  PoseGlobalMatrix by_camera = PoseGlobalMatrix::Zero();  // of the gradient, d / d parameters
  Eigen::Vector3d d_w = Eigen::Vector3d::Zero();          // from the camera to the marker, metres
  Vector6d moved = Vector6d::Zero();  // the marker, from its point to where it is
};

// False when a corner is behind the camera. Jacobians at the marker's point, residuals where it is.
// Corners beyond `huber` pull as in the optimizations.
bool linearizeView(const Transform& point, const MapMarker& marker,
                   const MarkerDetection& detection, const Keyframe& keyframe,
                   const CameraUncertainty& camera, double huber, LinearizedView* view) {
  const auto [first, parameters] = camera.unknown();
  const Transform& T_w_c = keyframe.T_w_c;
  const Transform& T_w_m = *marker.T_w_m;
  const auto corners_m = markerCorners(marker.size_m);
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d arm = point.R.leftCols<2>() * corners_m[k].head<2>();
    Projection projection;
    if (!projectPoint(T_w_c, point.p + arm, &projection)) return false;
    const Eigen::Vector3d corner_c = T_w_c.R.transpose() * (T_w_m * corners_m[k] - T_w_c.p);
    if (corner_c.z() < kNearestDepth) return false;
    const Eigen::Matrix2d W = detection.covariance[k].inverse();
    const Eigen::Vector2d r = corner_c.head<2>() / corner_c.z() - detection.normalized[k];
    const Eigen::Vector2d Wr = W * r;
    addSquare(projection.J_point, arm, W, &view->information);
    view->gradient +=
        huberWeight(r.dot(Wr), huber) * transposedJacobianTimes(projection.J_point, arm, Wr);
    if (parameters == 0) continue;
    const CornerByCamera seen = cornerByCamera(camera, detection.pixels[k], corner_c,
                                               keyframe.twist, keyframe.monotonic_ns);
    for (int i = first; i < first + parameters; ++i) {
      view->by_camera.col(i) -= transposedJacobianTimes(projection.J_point, arm, W * seen.col(i));
    }
  }
  mirror(&view->information);
  return true;
}

// The same of a marker that was carried to the keyframe. variance: that of the residuals, in whose
// units the equations are.
void linearizeLink(const Transform& T_w_m, const MarkerLink& link, const Transform& T_w_c,
                   double variance, LinearizedView* view) {
  view->information = variance * turnedCovariance(T_w_c.R, link.covariance.inverse());
  view->gradient = view->information * (T_w_c * link.T_c_m).localCoordinates(T_w_m);
}

// Where the block of two of n markers is, row >= column.
std::size_t placeOf(std::size_t row, std::size_t column, std::size_t n) {
  return column * n - column * (column + 1) / 2 + row;
}

// Where that of a marker by one of the parameters is.
std::size_t placeOf(std::size_t marker, int parameter, int count) {
  return marker * static_cast<std::size_t>(count) + static_cast<std::size_t>(parameter);
}

// A_i where i = j, less A_i T_i C^-1 T_j^T A_j, C = sum T_i^T A_i T_i; and on the right sides less
// g_i, and A_i T_i C^-1 sum T_j^T g_j. (Moving the camera is moving all it sees the other way: the
// camera's Jacobian is that of the marker times -T, T = rigidTransport(d).)
void eliminateCamera(const std::vector<LinearizedView>& views, KeyframeInformation* information) {
  const std::size_t n = information->unknown.size();
  Matrix6d C = Matrix6d::Zero();
  Vector6d pull = Vector6d::Zero();
  const auto [first, count] = information->parameters;
  PoseGlobalMatrix pull_by_camera = PoseGlobalMatrix::Zero();
  std::vector<Matrix6d> Y(views.size());  // A_i T_i, later times L^-T
  for (std::size_t i = 0; i < views.size(); ++i) {
    const LinearizedView& view = views[i];
    Y[i] = transposedTransport(view.d_w, view.information).transpose();
    C += transposedTransport(view.d_w, Y[i]);
    pull += transposedTransport(view.d_w, view.gradient);
    for (int p = first; p < first + count; ++p) {
      pull_by_camera.col(p) += transposedTransport<1>(view.d_w, view.by_camera.col(p));
    }
  }
  if (!factorizeCholesky(&C)) {  // where the camera is, is open: so is what it says
    std::ranges::fill(information->blocks, Matrix6d::Zero());
    std::ranges::fill(information->right, Vector6d::Zero());
    std::ranges::fill(information->by_camera, Vector6d::Zero());
    return;
  }
  solveLower(C, &pull);
  if (count > 0) solveLower(C, &pull_by_camera);
  for (Matrix6d& Y_i : Y) divideByTransposed(C, &Y_i);
  for (std::size_t j = 0; j < views.size(); ++j) {
    if (views[j].index < 0) continue;  // the fixed ones come first
    const auto column = static_cast<std::size_t>(views[j].index);
    information->right[column].noalias() += Y[j] * pull;
    for (int p = 0; p < count; ++p) {
      information->by_camera[placeOf(column, p, count)] += Y[j] * pull_by_camera.col(first + p);
    }
    for (std::size_t i = j; i < views.size(); ++i) {
      const auto row = static_cast<std::size_t>(views[i].index);
      subtractProduct(Y[i], Y[j], &information->blocks[placeOf(row, column, n)]);
    }
  }
}

// The right sides, from where the markers are to their points. (Where the camera is does not matter
// to them, to first order: it is eliminated.)
void moveToPoints(const std::vector<LinearizedView>& views, KeyframeInformation* information) {
  const std::size_t n = information->unknown.size();
  for (const LinearizedView& view : views) {
    if (view.index < 0 || view.moved.isZero(0.0)) continue;
    const auto moved = static_cast<std::size_t>(view.index);
    for (std::size_t i = 0; i < n; ++i) {
      const Matrix6d& block =
          information->blocks[placeOf(std::max(i, moved), std::min(i, moved), n)];
      if (i >= moved) {
        information->right[i].noalias() += block * view.moved;
      } else {
        information->right[i].noalias() += block.transpose() * view.moved;
      }
    }
  }
}

bool isSame(const MarkerLink& a, const MarkerLink& b) {
  return a.marker == b.marker && a.T_c_m.p == b.T_c_m.p && a.T_c_m.R == b.T_c_m.R &&
         a.covariance == b.covariance;
}

}  // namespace

bool isStillLinear(const Transform& then, const Transform& now, double side_m) {
  const double bound_m = kStillLinear_sides * side_m;
  // |R - R'|^2 = 8 sin^2(angle / 2), Frobenius' norm.
  return (now.p - then.p).squaredNorm() <= bound_m * bound_m &&
         (now.R - then.R).squaredNorm() <= 2.0 * kStillLinear_rad * kStillLinear_rad;
}

const LinearizationPoint& LinearizationPoints::follow(int marker, const Transform& T_w_m,
                                                      double size_m) {
  LinearizationPoint& point = points_[marker];
  if (point.revision == 0 || !isStillLinear(point.T_w_m, T_w_m, size_m)) {
    point = {T_w_m, ++last_revision_};
  }
  return point;
}

std::size_t KeyframeInformation::bytes() const {
  return sizeof(*this) + links.capacity() * sizeof(MarkerLink) +
         markers.capacity() * sizeof(Marker) + unknown.capacity() * sizeof(int) +
         blocks.capacity() * sizeof(Matrix6d) +
         (right.capacity() + by_camera.capacity()) * sizeof(Vector6d);
}

KeyframeInformation beginInformation(const Keyframe& keyframe, bool held, double residual_sigma,
                                     const CameraUncertainty& camera, const MarkerLookup& markers) {
  KeyframeInformation information;
  information.T_w_c = keyframe.T_w_c;
  information.detections = keyframe.detections;
  information.links = keyframe.links;
  information.twist = keyframe.twist;
  information.parameters = camera.unknown();
  information.residual_sigma = residual_sigma;
  information.held = held;
  auto& named = information.markers;
  named.reserve(keyframe.detections.size() + keyframe.links.size());
  keyframe.forEachMarker([&](int id) { named.push_back({id, 0}); });
  std::ranges::sort(named, {}, &KeyframeInformation::Marker::id);
  const auto repeated = std::ranges::unique(named, {}, &KeyframeInformation::Marker::id);
  named.erase(repeated.begin(), repeated.end());
  information.unknown.reserve(named.size());
  for (auto& marker : named) {
    const LinearizedMarker* const known = markers(marker.id);
    if (known == nullptr) continue;
    marker.revision = known->point.revision;
    if (!known->fixed) information.unknown.push_back(marker.id);
  }
  return information;
}

bool isAsBefore(const KeyframeInformation& information, const Keyframe& keyframe, bool held,
                double residual_sigma, const CameraUncertainty& camera,
                const MarkerLookup& markers) {
  return information.detections.data() == keyframe.detections.data() && information.held == held &&
         std::abs(information.residual_sigma - residual_sigma) <= kSameSigma * residual_sigma &&
         isStillLinear(information.T_w_c, keyframe.T_w_c, information.smallest_m) &&
         information.twist == keyframe.twist && information.parameters == camera.unknown() &&
         std::ranges::equal(information.links, keyframe.links, isSame) &&
         std::ranges::all_of(information.markers, [&](const auto& marker) {
           const LinearizedMarker* const known = markers(marker.id);
           return marker.revision == (known == nullptr ? 0 : known->point.revision);
         });
}

void linearize(const Map& map, const Keyframe& keyframe, const CameraUncertainty& camera,
               const MarkerLookup& markers, KeyframeInformation* information) {
  const std::size_t n = information->unknown.size();
  const double sigma = information->residual_sigma;
  const double huber = BundleOptions{}.huber * sigma;  // as in the optimizations
  information->T_w_c = keyframe.T_w_c;
  information->blocks.assign(n * (n + 1) / 2, Matrix6d::Zero());
  information->right.assign(n, Vector6d::Zero());
  const auto [first, count] = information->parameters;
  information->by_camera.assign(n * static_cast<std::size_t>(count), Vector6d::Zero());
  information->smallest_m = 0.0;
  std::vector<LinearizedView> views;
  views.reserve(information->markers.size());
  const auto add = [&](int id, const auto& linearizeOne) {
    const auto named =
        std::ranges::lower_bound(information->markers, id, {}, &KeyframeInformation::Marker::id);
    if (named == information->markers.end() || named->id != id || named->revision == 0) return;
    const LinearizedMarker* const known = markers(id);
    const MapMarker* const marker = map.findPosed(id);
    LinearizedView view;
    const auto index = std::ranges::lower_bound(information->unknown, id);
    view.index = known->fixed ? -1 : static_cast<int>(index - information->unknown.begin());
    if (marker == nullptr || !linearizeOne(known->point.T_w_m, *marker, &view)) {
      named->revision = -1;  // to be tried again
      return;
    }
    view.d_w = known->point.T_w_m.p - keyframe.T_w_c.p;
    if (known->point.T_w_m.p != marker->T_w_m->p || known->point.T_w_m.R != marker->T_w_m->R) {
      view.moved = known->point.T_w_m.localCoordinates(*marker->T_w_m);
    }
    double& smallest_m = information->smallest_m;
    smallest_m = views.empty() ? marker->size_m : std::min(smallest_m, marker->size_m);
    views.push_back(view);
  };
  for (const MarkerDetection& detection : keyframe.detections) {
    add(detection.id, [&](const Transform& point, const MapMarker& marker, LinearizedView* view) {
      return linearizeView(point, marker, detection, keyframe, camera, huber, view);
    });
  }
  for (const MarkerLink& link : keyframe.links) {
    if (keyframe.find(link.marker) != nullptr) continue;
    add(link.marker, [&](const Transform&, const MapMarker& marker, LinearizedView* view) {
      linearizeLink(*marker.T_w_m, link, keyframe.T_w_c, sigma * sigma, view);
      return true;
    });
  }
  std::ranges::sort(views, {}, &LinearizedView::index);
  for (const LinearizedView& view : views) {
    if (view.index < 0) continue;
    const auto i = static_cast<std::size_t>(view.index);
    information->blocks[placeOf(i, i, n)] += view.information;
    information->right[i] -= view.gradient;
    for (int p = 0; p < count; ++p) {
      information->by_camera[placeOf(i, p, count)] -= view.by_camera.col(first + p);
    }
  }
  if (!information->held) eliminateCamera(views, information);
  moveToPoints(views, information);
}

const KeyframeInformation* KeptInformation::find(KeyframeId id) const {
  const auto found = keyframes_.find(id);
  return found == keyframes_.end() ? nullptr : &found->second;
}

const KeyframeInformation* KeptInformation::keep(KeyframeId id, KeyframeInformation* information) {
  forget(id);
  const std::size_t bytes = information->bytes();
  if (bytes_ + bytes > most_bytes_) return nullptr;
  bytes_ += bytes;
  ++kept_;
  return &keyframes_.emplace(id, std::move(*information)).first->second;
}

void KeptInformation::forget(KeyframeId id) { forgetBetween(id, id + 1); }

void KeptInformation::forgetBetween(KeyframeId from, KeyframeId before) {
  auto it = keyframes_.lower_bound(from);
  while (it != keyframes_.end() && it->first < before) {
    bytes_ -= it->second.bytes();
    it = keyframes_.erase(it);
  }
}

bool KeptInformation::letGo(int count) {
  for (; count > 0 && !keyframes_.empty(); --count) forget(keyframes_.begin()->first);
  return keyframes_.empty();
}

}  // namespace waymark::slam
