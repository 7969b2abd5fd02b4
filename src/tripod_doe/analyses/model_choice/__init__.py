"""Automatic choice of the model, point by point: pilot, its errors, selection of a candidate, stored choice of a study.

What a study asks for is checked in `tripod_doe.study.definition.accuracy_table`.
"""
