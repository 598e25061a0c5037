// The tool that the hand holds.
#pragma once

namespace haptrace {

/// One contact point: a ball around the tool's tip.
struct PointTool {
  double radius = 0;  ///< [m]; 0: a point
};

}  // namespace haptrace
