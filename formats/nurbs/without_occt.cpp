// STEP and IGES files, for builds without OCCT.
#include "base/error.h"
#include "formats/nurbs/nurbs_file.h"

namespace haptrace {

bool reads_step_files() noexcept {
  return false;
}

std::vector<NurbsData> load_nurbs_with_occt(const std::string& file) {
  throw input_error(file + ": this build does not read STEP and IGES files");
}

}  // namespace haptrace
