# SPDX-License-Identifier: GPL-3.0-or-later
# cmake -DNODE= -DSOURCE= -DPAGE= -DCPP= -P BuildViewPage.cmake
# Has Vite build the page of `maquette view` from SOURCE into PAGE, from packages that are there
# (tools/setup --web; nothing is loaded), and writes CPP, which holds every file of it.
file(REMOVE_RECURSE "${PAGE}")
if(NODE AND EXISTS "${SOURCE}/node_modules/vite/bin/vite.js")
  foreach(step "node_modules/typescript/bin/tsc;--noEmit"
      "node_modules/vite/bin/vite.js;build;--outDir;${PAGE};--emptyOutDir;--logLevel;warn")
    execute_process(COMMAND "${NODE}" ${step} WORKING_DIRECTORY "${SOURCE}" RESULT_VARIABLE failed)
    if(failed)
      message(FATAL_ERROR "the page of maquette view could not be built: node ${step}")
    endif()
  endforeach()
else()
  message(STATUS "maquette view is built without its page: no node, or no packages in ${SOURCE} "
    "(tools/setup --web)")
endif()
file(GLOB_RECURSE files RELATIVE "${PAGE}" "${PAGE}/*")
set(bytes "")
set(declared "")
set(rows "")
set(i 0)
foreach(file IN LISTS files)
  string(APPEND bytes
    "asm(\".section .rodata\\n.global maquette_page_${i}\\n.global maquette_page_${i}_end\\n\"\n"
    "    \"maquette_page_${i}:\\n.incbin \\\"${PAGE}/${file}\\\"\\nmaquette_page_${i}_end:\\n"
    ".byte 0\\n.previous\\n\");\n")
  string(APPEND declared "extern const char maquette_page_${i}[], maquette_page_${i}_end[];\n")
  string(APPEND rows "      page_file(\"${file}\", maquette_page_${i}, maquette_page_${i}_end),\n")
  math(EXPR i "${i} + 1")
endforeach()
file(WRITE "${CPP}" "// Written by cmake/BuildViewPage.cmake.
#include \"tools/view/view_page.hpp\"

#include <vector>

${bytes}
extern \"C\" {
${declared}}

namespace maquette::tools {

std::span<const PageFile> view_page() {
  [[maybe_unused]] const auto page_file = [](std::string_view name, const char* from, const char* to) {
    return PageFile{name, {from, static_cast<std::size_t>(to - from)}};
  };
  static const std::vector<PageFile> kFiles{
${rows}  };
  return kFiles;
}

}  // namespace maquette::tools
")
