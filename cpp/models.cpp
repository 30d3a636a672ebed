// The one place where the loops are compiled. A second copy for AVX2 was measured and won 0-10 % only: these loops wait
// for memory and for arc tangents.
#include "models.hpp"

#include "models_loops.hpp"

namespace teamslam {

RowLoops row_loops(Model model, int D, Kind a, Kind b) {
  switch (model) {
    case Model::relative_pose: return relative_pose_loops(D, a, b);
    case Model::point: return sighting_loops<PointMeasure>(D, a, b);
    case Model::range: return sighting_loops<RangeMeasure>(D, a, b);
    case Model::bearing: return sighting_loops<BearingMeasure>(D, a, b);
    case Model::range_bearing: return sighting_loops<RangeBearingMeasure>(D, a, b);
    case Model::position: return position_loops(D, a);
    case Model::pose: return pose_loops(D, a);
    case Model::corners: return corners_loops(D, a, b);
  }
  return {};
}

}  // namespace teamslam
