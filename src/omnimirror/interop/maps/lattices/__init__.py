"""Maps of few nodes with curves between them: for boards, shaders and chips without room for one of all pixels."""
