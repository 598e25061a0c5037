#include "cli/read_progress.h"
#include "cli/verb.h"
#include "formats/recording/crash_recovery.h"

#include <fmt/format.h>

namespace haptrace::cli {

Verb add_recover(CLI::App& app) {
  struct Arguments {
    std::string file, output;
    bool overwrite = false;
  };
  const auto arguments = std::make_shared<Arguments>();
  CLI::App* verb = app.add_subcommand("recover", "repair a recording whose writer was killed or whose file is damaged");
  verb->footer(
      "Writes the readable data into a new file, verifies it, and only then replaces the old file.\n"
      "Every haptrace verb reads an unfinished recording as it is; other programs may not.\n"
      "  haptrace recover session.h5");
  verb->add_option("file", arguments->file, "recording (HDF5)")->type_name("FILE.h5");
  verb->add_option("-o,--output", arguments->output, "write this file and leave FILE.h5 unchanged")
      ->type_name("OUT.h5");
  verb->add_flag("--overwrite", arguments->overwrite, "replace an existing OUT.h5");
  return {verb, [verb, arguments](const Output& output) {
            require(*verb, "file");
            keep_inputs(arguments->output, std::span(&arguments->file, 1));
            clean_up(output, arguments->output.empty() ? arguments->file : arguments->output);
            Recovery recovery;
            {
              ReadProgress progress(output, arguments->file);
              recovery = recover_recording(arguments->file, arguments->output, arguments->overwrite,
                                           progress.share_callback());
            }
            for (const std::string& note : recovery.notes) output.remark(note);
            const std::string text =
                !recovery.needed
                    ? fmt::format("{}: the recording is complete, {} samples; nothing to do\n", arguments->file,
                                  recovery.samples)
                    : fmt::format("{}: {} samples recovered{}\n", fmt::join(recovery.files, ", "), recovery.samples,
                                  recovery.unreadable > 0 ? fmt::format(", {} could not be read", recovery.unreadable)
                                                          : std::string());
            output.tell({{"file", arguments->file},
                         {"needed", recovery.needed},
                         {"samples", recovery.samples},
                         {"unreadable", recovery.unreadable},
                         {"damaged", recovery.damaged},
                         {"files", recovery.files},
                         {"notes", recovery.notes}},
                        text);
            return recovery.unreadable > 0 || recovery.damaged ? kStopped : kDone;
          }};
}

}  // namespace haptrace::cli
