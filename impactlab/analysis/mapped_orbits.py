class MappedOrbits: pass
