// The marginal covariances of a map's markers, from all that its keyframes have seen: the keyframes
// are eliminated from the normal equations of Eq. 33, one by one, and of the inverse of what is
// left only the blocks are computed that markers seen together share (Takahashi's recursion on the
// sparse factor). World: where the map's optimizations hold it (the first keyframe, an origin
// marker, anchors).
//
// They are those of the best map of these views, and about the map as it is: how far it is from the
// best one, which is one Gauss-Newton step on the same equations, goes in squared. (After a loop
// closure, and far from what was optimized last, that is the larger part.) Views of keyframes that
// were let go are not counted, though the map has learned from them.
//
// Of a parameter of the camera that is not known there is one right side more: with it, the same
// equations say where the markers would be.
#pragma once

#include <vector>

#include "base/task.h"
#include "slam/covariance/camera_uncertainty.h"
#include "slam/covariance/constraint_information.h"
#include "slam/covariance/keyframe_information.h"
#include "slam/covariance/marginals.h"
#include "slam/map/map.h"
#include "slam/map/marker_options.h"

namespace waymark::slam {

// residual_sigma: standard deviation of the map's whitened residuals; covariances grow with its
// square. Markers that no keyframe sees together with others (an imported map) have the covariance
// that the map gives them. The map may grow meanwhile; it must outlive the task. Should the system
// be singular, the result is empty. kept: what earlier recoveries have linearized, used where
// nothing has changed since, and brought up to date; it must outlive the task, too. constraints:
// what is known of the markers besides their views, held against all else; only where asked for.
Task<MapMarginals> recoverMarginals(const Map& map, const MarkerOptions& markers,
                                    CameraUncertainty camera, double residual_sigma, Budget* budget,
                                    KeptInformation* kept = nullptr,
                                    std::vector<ConstraintResidual>* constraints = nullptr);

}  // namespace waymark::slam
