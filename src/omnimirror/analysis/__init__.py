"""Analysis of a sensor: imaging characteristics, viewpoints, virtual images, blur and complete
evaluation.
"""
