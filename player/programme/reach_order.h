// The reaches, or pairs of places, of an exercise in their order, drawn from the programme's seed.
#pragma once

#include "formats/documents/reach_task.h"
#include "formats/documents/sense_task.h"
#include "player/programme/trial_order.h"

#include <vector>

namespace haptrace {

/// Returns all reaches of an exercise, block by block. Targets come in cycles, each with every target once in a random
/// order, and no target follows itself. In each block, the shares of clamps and catch trials are rounded to whole
/// numbers. They lie at random places: none among the first five reaches of the block, and no two in a row. The hold in
/// the start is drawn evenly between its bounds, in steps of a thousandth of their difference.
///
/// Throws Error(input) naming the block if its clamps and catch trials have no room.
std::vector<PlannedReach> order_of_reaches(const ReachTask& task, OrderDraw& draw);

/// Returns all pairs of an exercise in a random order: each difference as often with the farther place first as second.
std::vector<SenseTrial> order_of_pairs(const SenseTask& task, OrderDraw& draw);

}  // namespace haptrace
