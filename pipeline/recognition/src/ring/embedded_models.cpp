// The files of ring_models/ are embedded by the assembler.

// RING_MODEL(NAME, FILE): the bytes from NAME to NAME_end.
#define RING_MODEL(name, file)                                                                     \
  __asm__(".pushsection .rodata\n.balign 8\n.hidden " #name "\n.global " #name "\n" #name          \
          ":\n.incbin \"" REVISIT_RING_MODELS "/" file "\"\n.hidden " #name "_end\n.global " #name \
          "_end\n" #name "_end:\n.popsection\n")

RING_MODEL(revisit_ring_hdl64, "hdl64.ring");
RING_MODEL(revisit_ring_vlp16, "vlp16.ring");
RING_MODEL(revisit_ring_ouster_os1_64, "ouster-os1-64.ring");
RING_MODEL(revisit_ring_livox_mid360, "livox-mid360.ring");
RING_MODEL(revisit_ring_hdl64_squeezenet, "hdl64-squeezenet.ring");
RING_MODEL(revisit_ring_vlp16_squeezenet, "vlp16-squeezenet.ring");
RING_MODEL(revisit_ring_ouster_os1_64_squeezenet, "ouster-os1-64-squeezenet.ring");
